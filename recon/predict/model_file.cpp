// SPDX-License-Identifier: MIT
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "drivers/util/caused_error.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/new_file.hpp"
#include "recon/data/files.hpp"
#include "recon/predict/trained_model.hpp"

namespace echofuse::recon {
namespace {

constexpr std::int64_t format_version = 18;
constexpr std::size_t max_estimators = 3;

void archive_training(Archive archive, TrainingRecords& training) {
  std::size_t runs = training.runs.size();
  archive.count("runs", runs, 0, 1 << 20);
  training.runs.resize(runs);
  for (std::size_t r = 0; r < runs; ++r)
    archive.text("run/" + std::to_string(r), training.runs[r], {});
  archive.values("run", training.run, Archive::any);
  archive.values("index", training.index, training.run.size());
  archive.values("part", training.part, training.run.size());
  archive.values("hash", training.hash, training.run.size());
  for (const std::uint32_t run : training.run)
    archive.require(run < runs, "run", "expected indices below the number of runs");
  for (const std::uint8_t part : training.part)
    archive.require(part <= static_cast<std::uint8_t>(Subset::test), "part", "expected 0, 1 or 2");
}

void archive_split(Archive archive, SplitOptions& split) {
  archive.text("kind", split.kind, {"random", "blocked"});
  archive.count("gap", split.gap, 0, 1 << 30);
  auto seed = static_cast<std::int64_t>(split.seed);
  archive.count("seed", seed, std::numeric_limits<std::int64_t>::min(),
                std::numeric_limits<std::int64_t>::max());
  split.seed = static_cast<std::uint64_t>(seed);
  archive.number("test_share", split.test_share, 0, 1);
  archive.number("validation_share", split.validation_share, 0, 1);
}

// Requires that all estimators have the axes of the first one, and that each uses fewer sensors
// than the previous one.
void check_list(const Archive& archive, const TrainedModel& model) {
  const Features& first = model.first().features;
  for (std::size_t k = 1; k < model.estimators.size(); ++k) {
    const Features& own = model.estimators[k].features;
    const Features& before = model.estimators[k - 1].features;
    const std::string name = std::to_string(k);
    const bool of_profile = own.inputs == Inputs::fused_profile && before.axes.array.count > 0;
    archive.require(both_sensors(before.inputs) && (own.inputs == Inputs::spd || of_profile),
                    name + "/inputs", "expected fewer sensors than in the previous estimator");
    archive.require(same_axis(own.axes.spd, first.axes.spd) &&
                        (!of_profile || same_axis(own.axes.radar, first.axes.radar)),
                    name + "/axes", "expected the same axes as in the first estimator");
    archive.require(model.estimators[k].scene.grid == model.first().scene.grid,
                    name + "/scene/map_size",
                    "expected the same map grid as in the first estimator");
  }
}

void check_format(Archive archive) try {
  std::string format = "echofuse model";
  archive.text("format", format, {format});
  std::int64_t found = format_version;
  archive.count("format_version", found, 0, 1 << 20);
  archive.require(
      found == format_version, "format_version",
      "is " + std::to_string(found) + "; expected " + std::to_string(format_version) +
          (found > format_version ? ": use a newer echofuse" : ": train the model again"));
} catch (const Error& error) {
  throw CausedError(Cause::other_format, error.what(), error.code());
}

void archive(Archive archive, TrainedModel& model) {
  check_format(archive);
  std::string by = version();
  archive.text("version", by, {});
  std::size_t estimators = model.estimators.size();
  archive.count("estimators", estimators, 1, max_estimators);
  model.estimators.resize(estimators);
  archive.count("data_crc32c", model.data_hash, 0, std::numeric_limits<std::uint32_t>::max());
  model.response.archive(archive.in("response"));
  archive_split(archive.in("split"), model.split);
  archive.in("split").count("leave_doubtful", model.exclusions.doubtful, 0, 1);
  archive.in("split").count("leave_lossy", model.exclusions.lossy, 0, 1);
  archive_training(archive.in("split"), model.training);
  for (std::size_t k = 0; k < estimators; ++k)
    model.estimators[k].archive(archive.in(std::to_string(k)));
  check_list(archive, model);
}

}  // namespace

void check_can_save(const std::string& path) {
  if (std::filesystem::exists(path))
    throw Error(ExitCode::usage,
                path + ": the file exists; choose another --out, or remove the file");
  static_cast<void>(NewFile(path));
}

void save_model(const TrainedModel& model, const std::string& path,
                const std::function<void(const TrainedModel&)>& check) {
  TensorFile file;
  // The const_cast is safe, because the archive does not change the model in write mode.
  archive({file, Archive::Direction::write}, const_cast<TrainedModel&>(model));
  NewFile out(path, path + ".part");
  const Bytes bytes = file.to_bytes();
  out.create();
  out.append({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  out.keep();
  const TrainedModel written = load_model(out.path());
  if (check) check(written);
  if (out.publish_new()) return;
  throw Error(ExitCode::failed,
              path + ": another process created this file; the model was saved as " + out.path());
}

TrainedModel load_model(const std::string& name, ByteView contents) {
  TensorFile file(name, contents);
  TrainedModel out;
  archive({file, Archive::Direction::read}, out);
  return out;
}

TrainedModel load_model(const std::string& path) {
  if (::access(path.c_str(), R_OK) != 0)
    throw CausedError(cause_of(errno),
                      path + ": " + std::strerror(errno) + "; expected a model file");
  return load_model(path, read_file(path));
}

}  // namespace echofuse::recon
