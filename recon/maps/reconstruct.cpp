// SPDX-License-Identifier: MIT
#include "recon/maps/reconstruct.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <deque>
#include <filesystem>
#include <fstream>
#include <future>
#include <limits>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include "acquire/record/follow.hpp"
#include "acquire/record/run_names.hpp"
#include "acquire/record/run_reader.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"
#include "recon/data/files.hpp"
#include "recon/maps/map_files.hpp"
#include "recon/maps/written_maps.hpp"
#include "recon/numbers/text.hpp"
#include "recon/predict/predict.hpp"

namespace echofuse::recon {
namespace {

// Number of records predicted at a time; if options.follow is set, also the number read at a time.
constexpr std::size_t part_records = 64;

bool wants_uncertainty(const ReconstructOptions& options) {
  const auto& formats = options.formats;
  return std::find(formats.begin(), formats.end(), "uncertainty") != formats.end();
}

// Returns the record indices in the value of --rows. Throws Error(usage) if one is invalid.
std::set<std::int64_t> indices_of(const std::string& text) {
  std::set<std::int64_t> out;
  for (const std::string& word : split_at_commas(text)) {
    std::int64_t index = -1;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), index);
    if (error != std::errc{} || end != word.data() + word.size() || index < 0)
      throw Error(ExitCode::usage,
                  "--rows: \"" + word + "\": expected record indices, e.g. 3,7, or test");
    out.insert(index);
  }
  return out;
}

// Returns the indices of the run's records that were used to train the model; empty if the model
// was not trained on this run.
std::set<std::int64_t> trained_on(const TrainedModel& model, const std::string& uuid) {
  std::set<std::int64_t> out;
  for (std::size_t i = 0; i < model.training.index.size(); ++i)
    if (model.training.runs[model.training.run[i]] == uuid &&
        model.training.part[i] != static_cast<std::uint8_t>(Subset::test))
      out.insert(model.training.index[i]);
  return out;
}

// Writes OUT/run.txt. It identifies the reconstructed run, and lists the records of this run that
// were used to train the model.
void mark(const ReconstructOptions& options, const TrainedModel& model,
          const record::RunReader& run, const std::set<std::int64_t>& trained) {
  std::string numbers;
  for (const std::int64_t index : trained)
    numbers += (numbers.empty() ? trained_on_records : ",") + std::to_string(index);
  write_atomically(
      options.out + "/run.txt",
      run.info().uuid + "\n" + printable(run.path()) + "\n" + numbers +
          (numbers.empty() ? "" : "\n") + calibration_of(model) + "\n" +
          (options.range_offset_m == 0 ? ""
                                       : format("range offset %.9g m\n", options.range_offset_m)));
}

class StatusTable {
 public:
  explicit StatusTable(const std::string& path) : path_(path) {
    write_atomically(path,
                     "record,status,after_slot_s,x_m,z_m,lateral_interval_90_m,distance,two_bodies,"
                     "out_of_distribution,uncertainty\n");
    out_.open(path, std::ios::binary | std::ios::app);
  }
  void add(const RecordStatus& r) {
    const std::string made =
        (r.note.empty() ? "ok" : r.note) + (r.doubt.empty() ? "" : "; " + r.doubt);
    const std::string status = r.fault.empty() ? made : r.fault;
    out_ << r.index << "," << csv_text(status) << ","
         << (r.after_slot_s ? format("%.4f", *r.after_slot_s) : "")
         << (r.body ? format(",%.3f,%.3f,", r.body->x_m, r.body->z_m) : ",,,");
    if (r.uncertainty) add(*r.uncertainty);
    out_ << (r.uncertainty ? "," : ",,,,")
         << (r.fault.empty() ? calibration_name(r.uncertainty.has_value()) : "") << "\n";
  }
  void flush() {
    out_.flush();
    if (!out_) throw Error(ExitCode::disk, path_ + ": cannot write: " + std::strerror(errno));
  }
  void close() {
    flush();
    sync_file(path_);
  }

 private:
  void add(const PredictionUncertainty& c) {
    out_ << (std::isnan(c.lateral_interval_90_m) ? "" : format("%.3f", c.lateral_interval_90_m))
         << format(",%.3f,", c.out_of_distribution.distance)
         << (std::isnan(c.out_of_distribution.two_bodies)
                 ? ""
                 : format("%.3f", c.out_of_distribution.two_bodies))
         << ",\"" << c.out_of_distribution.text() << "\"";
  }
  std::string path_;
  std::ofstream out_;
};

class RunReconstructor {
 public:
  RunReconstructor(const TrainedModel& model, const ReconstructOptions& options)
      : model_(model),
        options_(options),
        files_(options.out, options.formats, model.first().scene),
        table_(options.out + "/records.csv"),
        started_(clock_.now()) {}

  // Reconstructs a complete run. Reads all records before it makes the first map, because notes
  // about the run depend on all of them.
  void take_all(const record::RunReader& run);
  // Reconstructs the records added to the run since the last call, and returns true if there were
  // any.
  bool take_new(const record::RunReader& run);
  void close() { files_.close(), table_.close(); }

 private:
  Dataset read(const record::RunReader& run, std::size_t at_most);
  Rows take_requested_rows(const Dataset& data);
  Records prepare_new(Dataset data);
  // Statuses of several consecutive records, each with the files of the map if the record has one.
  using PreparedMaps = std::vector<std::pair<RecordStatus, std::optional<MapFiles::Ready>>>;
  PreparedMaps make(const Records& records, std::span<const std::size_t> rows) const;
  void write(const Records& records, std::span<const std::size_t> rows, PreparedMaps made);
  void report_run(const std::string& text) const;
  void report(const RecordStatus& status);
  void report_damaged(std::int64_t before);
  void time(RecordStatus& status, HostTime slot_end) const;

  const TrainedModel& model_;
  const ReconstructOptions& options_;
  MapFiles files_;
  StatusTable table_;
  SystemClock clock_;
  HostTime started_, read_{};
  std::int64_t next_ = 0;
  std::deque<RecordStatus> bad_;   // unusable records that were read but have not been reported
  std::string antennas_, ranges_;  // most recently reported notes on the antennas and ranges
  double interval_factor_ = 1;     // factor of the whole run (DomainShift)
};

// Reads the next records without depth images, because these are not needed to predict maps.
Dataset RunReconstructor::read(const record::RunReader& run, std::size_t at_most) {
  Dataset out = load_part(run, next_, at_most, sensors_of(model_.first().features.inputs),
                          [&](std::int64_t index, const std::string& fault) {
                            bad_.push_back({index, fault, {}, {}});
                          });
  read_ = clock_.now();
  return out;
}

// Returns the rows of a complete run that were requested by options.rows. Discards the reports of
// unusable records that are not requested.
Rows RunReconstructor::take_requested_rows(const Dataset& data) {
  if (options_.rows.empty()) return all_rows(data.size());
  if (options_.rows == "test") {
    Rows rows = model_.rows_of(data, Subset::test);
    if (rows.empty())
      throw Error(ExitCode::failed,
                  "--rows test: the model was not trained on this run, or its training "
                  "held out no records");
    std::ranges::sort(rows);
    return bad_.clear(), rows;
  }
  std::set<std::int64_t> expected = indices_of(options_.rows);
  std::erase_if(bad_, [&](const RecordStatus& r) { return !expected.contains(r.index); });
  for (const RecordStatus& r : bad_) expected.erase(r.index);
  Rows rows;
  for (std::size_t row = 0; row < data.size(); ++row)
    if (expected.erase(data.records[row].index) > 0) rows.push_back(row);
  if (!expected.empty())
    throw Error(ExitCode::failed,
                "--rows: the run has no record " + std::to_string(*expected.begin()));
  return rows;
}

void RunReconstructor::take_all(const record::RunReader& run) {
  const auto count = static_cast<std::size_t>(run.count());
  Progress progress("reconstructing", count, options_.quiet);
  const Records records = prepare_records(model_, read(run, count), options_.range_offset_m);
  const Rows rows = take_requested_rows(records.data);
  // Also finds training records by their counts, in case the run is a copy with another identifier.
  std::set<std::int64_t> trained = trained_on(model_, run.info().uuid);
  for (const std::size_t row : model_.rows_trained_on(records.data))
    trained.insert(records.data.records[row].index);
  mark(options_, model_, run, trained);
  // Threading: this thread tests the run and writes one part, while other threads predict and
  // encode the next parts.
  const std::size_t ahead = std::max(2u, usable_cores());
  std::deque<std::future<PreparedMaps>> next;
  auto start = [&, left = std::span(rows)]() mutable {
    if (left.empty()) return;
    const auto some = left.first(std::min(part_records, left.size()));
    next.push_back(std::async(std::launch::async, [&, some] { return make(records, some); }));
    left = left.subspan(some.size());
  };
  for (std::size_t i = 0; i < ahead; ++i) start();
  report_run(records.antennas);
  if (!options_.quiet) report_run(records.response), report_run(records.ranges);
  const DomainShift shift = domain_shift_of(model_, records.data);
  interval_factor_ = shift.interval_factor;
  if (shift.tested() && (shift.found() || interval_factor_ > 1 || !options_.quiet))
    report_run(shift.text());
  for (std::size_t done = 0; !next.empty() && !interrupted(); next.pop_front()) {
    PreparedMaps made = next.front().get();
    start();
    const std::size_t more = made.size();
    write(records, std::span(rows).subspan(done, more), std::move(made));
    progress.update(done += more);
  }
  if (!interrupted()) report_damaged(std::numeric_limits<std::int64_t>::max());
  table_.flush();
}

bool RunReconstructor::take_new(const record::RunReader& run) {
  const std::int64_t before = next_;
  const Records records = prepare_new(read(run, part_records));
  const Rows rows = all_rows(records.data.size());
  write(records, rows, make(records, rows));
  report_damaged(std::numeric_limits<std::int64_t>::max());
  table_.flush();
  return next_ != before;
}

Records RunReconstructor::prepare_new(Dataset data) {
  const Rows all = all_rows(data.size());
  // While a run is being recorded, the axis of a sensor may be missing when the first records are
  // read.
  if (std::none_of(all.begin(), all.end(),
                   [&](std::size_t row) { return model_.fault_of(data, row).empty(); }))
    return {std::move(data), {}, {}, {}};
  Records out = prepare_records(model_, std::move(data), options_.range_offset_m);
  if (out.antennas != antennas_) report_run(antennas_ = out.antennas);
  if (!options_.quiet && out.ranges != ranges_) report_run(ranges_ = out.ranges);
  return out;
}

void RunReconstructor::report_run(const std::string& text) const {
  if (!text.empty() && options_.on_run) options_.on_run(text);
}

RunReconstructor::PreparedMaps RunReconstructor::make(const Records& records,
                                                      std::span<const std::size_t> rows) const {
  const bool deviations = wants_uncertainty(options_);
  std::vector<MappedRecord> maps = map_records(
      model_, records, rows, deviations ? PredictionDetail::pixels : PredictionDetail::uncertainty);
  PreparedMaps out;
  for (MappedRecord& made : maps) {
    auto& [status, files] = out.emplace_back(std::move(made.status), std::nullopt);
    if (status.fault.empty()) files = files_.prepare(status.index, made.map_m, made.deviation_m);
  }
  return out;
}

void RunReconstructor::write(const Records& records, std::span<const std::size_t> rows,
                             PreparedMaps made) {
  for (std::size_t i = 0; i < made.size(); ++i)
    if (auto& [status, files] = made[i]; files)
      files_.write(*files), time(status, records.data.records[rows[i]].slot_end);
  for (std::size_t i = 0; i < made.size(); ++i) {
    RecordStatus& status = made[i].first;
    if (status.uncertainty) status.uncertainty->lateral_interval_90_m *= interval_factor_;
    report_damaged(status.index), report(status);
  }
}

void RunReconstructor::report(const RecordStatus& status) {
  table_.add(status);
  if (options_.on_record) options_.on_record(status);
  next_ = status.index + 1;
}

void RunReconstructor::report_damaged(std::int64_t before) {
  for (; !bad_.empty() && bad_.front().index < before; bad_.pop_front()) report(bad_.front());
}

void RunReconstructor::time(RecordStatus& status, HostTime slot_end) const {
  if (!options_.follow || slot_end < started_) return;
  status.after_slot_s = seconds(clock_.now() - slot_end);
  status.after_reading_s = seconds(clock_.now() - read_);
}

// Throws Error(usage) if the folder contains maps of a run other than the run `uuid`, because the
// old and new maps would be mixed.
void require_folder(const ReconstructOptions& options, const std::string& uuid) {
  const std::string marker = options.out + "/run.txt";
  const bool known = std::filesystem::exists(marker);
  const std::string before = known ? read_text(marker) : "";
  if (options.force || before.starts_with(uuid + "\n") ||
      (!known && !std::filesystem::exists(options.out + "/records.csv")))
    return;
  const auto line = before.find('\n');
  const std::string owner = line < 64
                                ? before.substr(line + 1, before.find('\n', line + 1) - line - 1)
                                : "an unknown run";
  throw Error(ExitCode::usage, options.out + ": contains maps of another run, " + printable(owner) +
                                   "; choose another --out, or use --force");
}

}  // namespace

void reconstruct(const TrainedModel& model, const std::string& path,
                 const ReconstructOptions& options) {
  if (wants_uncertainty(options)) require_uncertainty(model);
  // Throws an error before any output is written if an index is invalid.
  if (options.rows != "test") indices_of(options.rows);
  const std::string file = record::old_run(path);
  {
    const record::RunReader run(file);
    const std::string uuid = run.info().uuid;
    require_folder(options, uuid);  // throws an error before any file is changed
    make_folder(options.out);
    mark(options, model, run, trained_on(model, uuid));
  }
  RunReconstructor work(model, options);
  if (!options.follow) work.take_all(record::RunReader(file));
  if (options.follow)
    record::follow(
        file, [&](const record::RunReader& run) { return work.take_new(run); },
        [] { return !interrupted(); });
  work.close();
}

}  // namespace echofuse::recon
