// SPDX-License-Identifier: MIT
#include "recon/cli/commands.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <map>

#include "drivers/util/command_line.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/maps/map_files.hpp"
#include "recon/maps/reconstruct.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/predict/empty_room.hpp"

namespace echofuse::recon {

void add_range_offset_option(CLI::App& app, double& offset_m) {
  app.add_option("--range-offset", offset_m,
                 "radar range bias, m; it is subtracted from the ranges of this run and of the "
                 "--empty run, in addition to the offset in the calibration")
      ->check(CLI::Range(-10.0, 10.0))
      ->capture_default_str();
}

void add_empty_option(CLI::App& app, std::string& path) {
  app.add_option(
         "--empty", path,
         "run recorded in the empty room; only needed if the room differs from the training room")
      ->type_name("RUN");
}

TrainedModel model_for_room(const std::string& path, const std::string& empty,
                            double range_offset_m) {
  TrainedModel model = load_model(path);
  const std::string text = empty.empty() ? "" : adapt_to_room(model, empty, range_offset_m);
  if (!text.empty()) std::fprintf(stderr, "%s\n", text.c_str());
  return model;
}

namespace {

void add_model_and_run(CLI::App& app, std::string& model, std::string& run) {
  app.add_option("model", model, "model file")->type_name("MODEL")->required();
  app.add_option("run", run, "run file")->type_name("RUN")->required();
}

// Prints notes about records to stderr. In follow mode, prints each note immediately. Otherwise
// prints all notes once the progress bar has finished.
class ReconstructReport {
 public:
  ReconstructReport(std::string run, bool follow, bool quiet)
      : run_(std::move(run)), follow_(follow), quiet_(quiet) {}
  bool all_well() const { return left_out_ + notes_.size() == 0; }

  void add(const RecordStatus& r) {
    if (r.after_slot_s) after_slot_s_.push_back(*r.after_slot_s);
    (r.fault.empty() ? good_ : left_out_) += 1;
    if (!r.note.empty()) ++notes_[r.note];
    if (!r.doubt.empty()) ++doubts_[r.doubt];
    if (!r.fault.empty() && !follow_) faults_.push_back(r);
    if (r.uncertainty && !r.uncertainty->out_of_distribution.reason.empty())
      ++reasons_[r.uncertainty->out_of_distribution.reason];
    if (follow_ && !(r.fault.empty() && r.note.empty())) report(r);
    if (follow_ && r.uncertainty && !r.uncertainty->out_of_distribution.reason.empty() && !quiet_)
      std::fprintf(stderr, "record %lld: out of distribution: %s\n",
                   static_cast<long long>(r.index),
                   r.uncertainty->out_of_distribution.text().c_str());
    if (follow_ && r.after_slot_s && !quiet_)
      std::fprintf(
          stderr,
          "record %lld: map ready %.3f s after the end of the slot, %.1f ms after the record "
          "was read\n",
          static_cast<long long>(r.index), *r.after_slot_s, *r.after_reading_s * 1e3);
  }

  void finish(const std::string& out) {
    std::map<std::string, std::vector<const RecordStatus*>> similar;
    for (const auto& r : faults_) similar[r.fault.empty() ? r.note : r.fault].push_back(&r);
    for (const auto& r : faults_)
      if (similar.at(r.fault.empty() ? r.note : r.fault).size() < summary_threshold) report(r);
    for (const auto& [text, of] : similar)
      if (of.size() >= summary_threshold)
        std::fprintf(stderr, "%s: %zu records between %lld and %lld: %s\n", printable(run_).c_str(),
                     of.size(), static_cast<long long>(of.front()->index),
                     static_cast<long long>(of.back()->index), printable(text).c_str());
    if (quiet_) return;
    std::fprintf(stderr, "%s: %zu records reconstructed, %zu left out", printable(out).c_str(),
                 good_, left_out_);
    for (const auto& [note, count] : notes_)
      std::fprintf(stderr, "; %zu with a fallback model (%s)", count, note.c_str());
    for (const auto& [doubt, count] : doubts_)
      std::fprintf(stderr, "; %zu with doubtful data: %s", count, doubt.c_str());
    std::sort(after_slot_s_.begin(), after_slot_s_.end());
    if (!after_slot_s_.empty())
      std::fprintf(stderr, "; maps ready %.3f s after the end of the slot (median; maximum %.3f s)",
                   after_slot_s_[after_slot_s_.size() / 2], after_slot_s_.back());
    std::fputc('\n', stderr);
    if (!reasons_.empty()) list_reasons();
  }

 private:
  void list_reasons() const {
    std::size_t all = 0;
    std::string reasons;
    for (const auto& [reason, count] : reasons_) {
      all += count;
      reasons += format("%s%zu %s", reasons.empty() ? "" : "; ", count, reason.c_str());
    }
    std::fprintf(stderr, "%zu of %zu records are out of distribution: %s\n", all, good_,
                 reasons.c_str());
  }
  void report(const RecordStatus& r) const {
    std::fprintf(stderr, "%s: record %lld: %s\n", printable(run_).c_str(),
                 static_cast<long long>(r.index),
                 printable(r.fault.empty() ? r.note : r.fault).c_str());
  }
  // If at least this many records have the same fault or note, only one line is printed for all of
  // them.
  static constexpr std::size_t summary_threshold = 10;
  std::string run_;
  bool follow_, quiet_;
  std::size_t good_ = 0, left_out_ = 0;
  std::vector<RecordStatus> faults_;
  std::vector<double> after_slot_s_;
  // Number of records with each note, each doubtful verdict, and each reason for being out of
  // distribution.
  std::map<std::string, std::size_t> notes_, doubts_, reasons_;
};

}  // namespace

Command add_reconstruct(CLI::App& app, const Common& common) {
  struct Arguments : ReconstructOptions {
    std::string model, run, empty;
  };
  const auto a = std::make_shared<Arguments>();
  add_model_and_run(app, a->model, a->run);
  app.add_option("--out", a->out, "folder for the maps")->type_name("FOLDER")->required();
  app.add_option("--format", a->formats, "map formats; one or more of: " + map_format_help())
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::IsMember(map_format_names()))
      ->capture_default_str();
  add_empty_option(app, a->empty);
  add_range_offset_option(app, a->range_offset_m);
  CLI::Option* const rows =
      app.add_option("--rows", a->rows,
                     "records to reconstruct: a list of indices, e.g. 3,7, or the word test for "
                     "the records that were held out when MODEL was trained");
  app.add_flag("--follow", a->follow,
               "follow a run in progress: reconstruct new records until the run is closed")
      ->excludes(rows);
  app.add_flag("--force", a->force, "write into a folder that contains maps of another run");
  more_options(app, {"--rows", "--empty", "--range-offset", "--force"});
  add_examples(app,
               {"echofuse-recon reconstruct fused.safetensors monday.sqlite --out maps",
                "echofuse-recon reconstruct fused.safetensors monday.sqlite --follow --out maps"},
               "5 some records have no map, 6 disk, 130 interrupted");
  return [a, &common] {
    a->quiet = common.quiet;
    ReconstructReport talk(a->run, a->follow, common.quiet);
    a->on_record = [&](const RecordStatus& r) { talk.add(r); };
    a->on_run = [&](const std::string& text) {
      std::fprintf(stderr, "%s: %s\n", printable(a->run).c_str(), printable(text).c_str());
    };
    const TrainedModel model = model_for_room(a->model, a->empty, a->range_offset_m);
    reconstruct(model, a->run, *a);
    if (!model.first().uncertainty && !common.quiet)
      std::fprintf(stderr, "%s: %s: %s\n", printable(a->model).c_str(), calibration_of(model),
                   reason_not_calibrated);
    talk.finish(a->out);
    if (interrupted()) return ExitCode::interrupted;
    return talk.all_well() ? ExitCode::ok : ExitCode::partial;
  };
}

}  // namespace echofuse::recon
