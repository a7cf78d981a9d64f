// SPDX-License-Identifier: MIT
#include "recon/output/reconstruct.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

#include "acquire/record/run_file.hpp"
#include "drivers/core/console.hpp"
#include "drivers/core/csv.hpp"
#include "drivers/core/printable.hpp"
#include "recon/estimator/answer.hpp"
#include "recon/files/files.hpp"
#include "recon/files/text.hpp"
#include "recon/output/map_files.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t part_records = 256;  // read and predicted at once
constexpr std::chrono::milliseconds pause_between_looks(20);
constexpr std::size_t slip_window = 500;      // bodies, while following: what came last
constexpr std::size_t slip_watch_every = 25;  // bodies

bool wants_uncertainty(const ReconstructOptions& options) {
  const auto& formats = options.formats;
  return std::find(formats.begin(), formats.end(), "uncertainty") != formats.end();
}

class StatusTable {
 public:
  explicit StatusTable(const std::string& path)
      : path_(path), out_(path, std::ios::binary | std::ios::trunc) {
    out_ << "record,status,after_slot_s,lateral_90_m,distance,two_bodies,unusual,radar_shift_m\n";
    flush();
  }
  void add(const RecordStatus& r) {
    const std::string status = !r.fault.empty() ? r.fault : !r.note.empty() ? r.note : "ok";
    out_ << r.index << "," << csv_text(status) << ","
         << (r.after_slot_s ? formatted("%.4f", *r.after_slot_s) : "") << ",";
    if (r.claim) add(*r.claim);
    out_ << (r.claim ? "," : ",,,,") << (r.fault.empty() ? formatted("%.4f", r.radar_shift_m) : "")
         << "\n";
  }
  void flush() {
    out_.flush();
    if (!out_) throw Error(ExitCode::disk, path_ + ": cannot write: " + std::strerror(errno));
  }

 private:
  void add(const Claim& c) {
    out_ << (std::isnan(c.lateral_90_m) ? "" : formatted("%.3f", c.lateral_90_m))
         << formatted(",%.3f,%.3f,\"", c.strangeness.distance, c.strangeness.two_bodies)
         << c.strangeness.text() << "\"";
  }
  std::string path_;
  std::ofstream out_;
};

// One part of a run after the other, from records to files.
class Reconstruction {
 public:
  Reconstruction(const TrainedModel& model, const ReconstructOptions& options)
      : model_(model),
        options_(options),
        files_(options.out, options.formats, model.scene),
        table_(options.out + "/records.csv"),
        started_(clock_.now()) {}

  // True if there was any record.
  bool take_part(const record::RunReader& run);
  // Looks whether a calibration slipped: of a whole run before its first map.
  void look_for_slip(const record::RunReader& run);
  std::size_t done() const { return done_; }
  void close() { files_.close(); }

 private:
  std::vector<RecordStatus> write_maps(Dataset& data);
  void watch_slip(const Dataset& data);
  void time(RecordStatus& status, HostTime slot_end, HostTime read) const;

  const TrainedModel& model_;
  const ReconstructOptions& options_;
  MapFiles files_;
  StatusTable table_;
  SystemClock clock_;
  HostTime started_;
  std::int64_t next_ = 0;
  std::size_t done_ = 0;
  double slip_m_ = 0;  // to be taken off the radar's ranges
  std::vector<float> displacements_m_;
  std::size_t watched_ = 0;
  Slip::Verdict verdict_ = Slip::Verdict::few;
};

bool Reconstruction::take_part(const record::RunReader& run) {
  std::vector<RecordStatus> bad;
  Dataset data = load_part(run, next_, part_records, [&](std::int64_t index, const auto& fault) {
    bad.push_back({index, fault, {}, 0, {}, {}, {}});
  });
  std::vector<RecordStatus> all = write_maps(data);
  all.insert(all.end(), bad.begin(), bad.end());
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.index < b.index; });
  for (const auto& r : all) {
    table_.add(r);
    if (options_.on_record) options_.on_record(r);
    next_ = r.index + 1;
  }
  table_.flush();
  done_ += all.size();
  return !all.empty();
}

void Reconstruction::look_for_slip(const record::RunReader& run) {
  if (options_.slip == SlipAction::ignore || !model_.slip.known()) return;
  std::vector<float> found;
  for (std::int64_t next = 0; !interrupted();) {
    Dataset part = load_part(run, next, part_records, [](std::int64_t, const auto&) {});
    if (part.size() == 0) break;
    next = part.index.back() + 1;
    model_.match(part);
    model_.slip.measure(part, found);
  }
  const Slip slip = model_.slip.judge(found);
  const bool correct = options_.slip == SlipAction::correct;
  if (correct && slip.verdict == Slip::Verdict::found) slip_m_ = slip.metres;
  if (options_.quiet && slip.verdict == Slip::Verdict::few) return;
  if (options_.on_slip && !slip.text(correct).empty()) options_.on_slip(slip.text(correct));
}

// While following: whenever one comes up. No correction, as it would come amid the maps.
void Reconstruction::watch_slip(const Dataset& data) {
  if (!options_.follow || options_.slip == SlipAction::ignore || !model_.slip.known()) return;
  const std::size_t before = displacements_m_.size(), looks = watched_ / slip_watch_every;
  model_.slip.measure(data, displacements_m_);
  watched_ += displacements_m_.size() - before;
  if (displacements_m_.size() > slip_window)
    displacements_m_.erase(displacements_m_.begin(),
                           displacements_m_.end() - static_cast<std::ptrdiff_t>(slip_window));
  if (watched_ / slip_watch_every == looks) return;
  const Slip slip = model_.slip.judge(displacements_m_);
  const bool news = slip.verdict == Slip::Verdict::found && verdict_ != slip.verdict;
  verdict_ = slip.verdict;
  if (news && options_.on_slip) options_.on_slip(slip.text(false));
}

std::vector<RecordStatus> Reconstruction::write_maps(Dataset& data) {
  const HostTime read = clock_.now();
  if (slip_m_ != 0) shorten_radar(data, slip_m_);
  std::vector<RecordStatus> out;
  Rows rows;
  for (std::size_t row = 0; row < data.size(); ++row) {
    const bool falls_back = model_.falls_back(data, row);
    out.push_back({data.index[row],
                   model_.fault_of(data, row),
                   falls_back ? fallback_note : "",
                   slip_m_,
                   {},
                   {},
                   {}});
    if (out.back().fault.empty()) rows.push_back(row);
  }
  // A sensor's axis may come after the first records of a run that is being recorded.
  if (!rows.empty() || !options_.follow) model_.match(data);
  if (!rows.empty()) watch_slip(data);
  const bool uncertainty = wants_uncertainty(options_);
  const Answer answers = answer(model_, data, rows, options_.output, uncertainty);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!answers.claims.empty()) out[rows[i]].claim = answers.claims[i];
    files_.write(data.index[rows[i]], answers.maps.row(i),
                 uncertainty ? answers.deviation.row(i) : std::span<const float>{});
    time(out[rows[i]], data.slot_end[rows[i]], read);
  }
  return out;
}

void Reconstruction::time(RecordStatus& status, HostTime slot_end, HostTime read) const {
  if (!options_.follow || slot_end < started_) return;
  status.after_slot_s = seconds(clock_.now() - slot_end);
  status.after_reading_s = seconds(clock_.now() - read);
}

// Maps of another run must not stay among those of this one unnoticed.
void claim_folder(const ReconstructOptions& options, const std::string& path,
                  const std::string& uuid) {
  const std::string marker = options.out + "/run.txt", own = uuid + "\n" + printable(path) + "\n";
  const bool known = std::filesystem::exists(marker);
  const std::string before = known ? read_text(marker) : "";
  if (!options.force && !before.starts_with(uuid + "\n") &&
      (known || std::filesystem::exists(options.out + "/records.csv"))) {
    const auto line = before.find('\n');
    const std::string whose = line < 64
                                  ? before.substr(line + 1, before.find('\n', line + 1) - line - 1)
                                  : "an unknown one";
    throw Error(ExitCode::usage, options.out + ": holds maps of another run, " + printable(whose) +
                                     "; give another --out, or --force to write among them");
  }
  make_folder(options.out);
  write_text(marker, own);
}

}  // namespace

void reconstruct(const TrainedModel& model, const std::string& path,
                 const ReconstructOptions& options) {
  if (options.output == "mean" || wants_uncertainty(options)) require_confidence(model);
  claim_folder(options, path, record::RunReader(path).info().uuid);  // refused before it changes
  Reconstruction work(model, options);
  if (!options.follow) {
    const record::RunReader run(path);
    work.look_for_slip(run);
    Progress progress("reconstructing", static_cast<std::size_t>(run.count()), options.quiet);
    while (!interrupted() && work.take_part(run)) progress.update(work.done());
  }
  while (options.follow && !interrupted()) {
    // Opened anew for each look: a run's writer leaves one single file only if nobody holds it.
    bool open = false;
    {
      const record::RunReader run(path);
      open = run.info().status == "open";  // asked first: what comes before the end is seen
      if (work.take_part(run)) continue;
    }
    if (!open) break;
    std::this_thread::sleep_for(pause_between_looks);
  }
  work.close();
}

}  // namespace echofuse::recon
