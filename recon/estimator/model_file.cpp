// SPDX-License-Identifier: MIT
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "drivers/core/console.hpp"
#include "recon/estimator/trained_model.hpp"
#include "recon/files/files.hpp"

namespace echofuse::recon {
namespace {

using record::H5File;

constexpr const char* format = "echofuse model";
constexpr std::int64_t format_version = 8;
// Since when a file is read: models of 7 know nothing of two bodies.
constexpr std::int64_t oldest_version = 7;
constexpr const char* fallback_group = "fallback";
constexpr std::int64_t most_bins = 1 << 20;
constexpr float farthest_m = 100;

void save_axis(H5File& file, const Axis& axis) {
  const std::string group = "axes/" + axis.name;
  file.make_group(group);
  file.set(group, "quantity", axis.quantity);
  file.set(group, "unit", axis.unit);
  file.set(group, "count", std::int64_t{axis.count});
  file.set(group, "start", axis.start);
  file.set(group, "step", axis.step);
  file.set(group, "scale", axis.scale);
}

Axis load_axis(const H5File& file, const std::string& name) {
  const std::string group = "axes/" + name;
  const auto count = file.get<std::int64_t>(group, "count");
  require_sound(file, count >= 0 && count <= most_bins, group + "@count",
                "0 to " + std::to_string(most_bins));
  const Axis axis{name,
                  file.get<std::string>(group, "quantity"),
                  file.get<std::string>(group, "unit"),
                  static_cast<std::uint32_t>(count),
                  file.get<double>(group, "start"),
                  file.get<double>(group, "step"),
                  file.get<double>(group, "scale")};
  require_sound(file, count == 0 || (axis.step >= 1e-9 && axis.step <= 1e9), group + "@step",
                "1e-9 to 1e9");
  require_sound(file, std::abs(axis.start) <= 1e9, group + "@start", "-1e9 to 1e9");
  return axis;
}

Axis load_array_axis(const H5File& file, const Features& features) {
  const Axis axis = load_axis(file, "array");
  const double lags = axis.scale;
  require_sound(file, features.inputs == Inputs::fused && features.scaling == raw_scaling,
                "axes/array", "none but of a fused model that looks at the body");
  require_sound(file, lags >= 1 && lags <= double{2 * most_lags} && lags == std::floor(lags),
                "axes/array@scale", "1 to " + std::to_string(2 * most_lags));
  require_sound(file, static_cast<double>(lags_up(axis)) < lags, "axes/array@quantity",
                "fewer lags up than there are lags");
  require_sound(file, axis.count > 0, "axes/array@count", "at least 1");
  return axis;
}

void save_head(H5File& file, const TrainedModel& m) {
  file.set(".", "format", std::string(format));
  file.set(".", "format_version", format_version);
  file.set(".", "model", m.name);
  file.set(".", "inputs", name_of(m.features.inputs));
  file.set(".", "scaling", m.features.scaling);
  file.set(".", "version", std::string(version()));
  file.set(".", "data_crc32c", std::int64_t{m.data_hash});
  file.set(".", "train_s", m.train_s);
  file.set(".", "uncertainty", std::string(calibration_of(m)));
  file.set(".", "foreground_depth_m", double{m.scene.foreground_depth_m});
  save_grid(file, m.scene.grid);
  file.set(".", "split", m.split.kind);
  file.set(".", "gap", static_cast<std::int64_t>(m.split.gap));
  file.set(".", "seed", static_cast<std::int64_t>(m.split.seed));
  file.set(".", "test_share", m.split.test_share);
  file.set(".", "validation_share", m.split.validation_share);
  file.set(".", "knows_empty_room", std::int64_t{m.knows_empty_room});
}

bool is_one_of(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

std::string load_choice(const H5File& file, const char* attribute,
                        const std::vector<std::string>& choices) {
  const auto found = file.get<std::string>(".", attribute);
  std::string all;
  for (const auto& one : choices) all += (all.empty() ? "" : ", ") + one;
  require_sound(file, is_one_of(choices, found), std::string(".@") + attribute, "one of " + all);
  return found;
}

template <class T>
T load_count(const H5File& file, const std::string& object, const char* attribute) {
  const auto found = file.get<std::int64_t>(object, attribute);
  require_sound(file, std::in_range<T>(found), object + "@" + attribute, "a number of its range");
  return static_cast<T>(found);
}

void load_head(const H5File& file, TrainedModel& m) {
  m.name = load_choice(file, "model", model_names());
  m.features.inputs = inputs_of(load_choice(file, "inputs", inputs_names));
  m.features.scaling =
      load_choice(file, "scaling",
                  wants_alignment(m.name) ? std::vector<std::string>{raw_scaling} : scaling_names);
  m.data_hash = load_count<std::uint32_t>(file, ".", "data_crc32c");
  m.train_s = file.get<double>(".", "train_s");
  m.scene.foreground_depth_m = static_cast<float>(file.get<double>(".", "foreground_depth_m"));
  require_sound(file, m.scene.foreground_depth_m >= 0 && m.scene.foreground_depth_m <= farthest_m,
                ".@foreground_depth_m", "0 to 100 m");
  m.scene.grid = load_grid(file);
  m.split.kind = load_choice(file, "split", {"random", "blocked"});
  m.split.gap = load_count<std::size_t>(file, ".", "gap");
  m.split.seed = static_cast<std::uint64_t>(file.get<std::int64_t>(".", "seed"));
  m.knows_empty_room = file.has_attribute(".", "knows_empty_room") &&
                       file.get<std::int64_t>(".", "knows_empty_room") != 0;
}

void save_training(H5File& file, const TrainedModel& m) {
  file.write("training/loss_m", m.log.loss, {m.log.loss.size()});
  file.write("training/validation_loss_m", m.log.validation_loss, {m.log.validation_loss.size()});
  const auto widths = m.fit.hidden.value_or(std::vector<std::size_t>{});
  const std::vector<std::uint64_t> hidden(widths.begin(), widths.end());
  file.write("training/hidden", hidden, {hidden.size()});
  file.set("training", "best_epoch", static_cast<std::int64_t>(m.log.best_epoch));
  file.set("training", "epochs", static_cast<std::int64_t>(m.fit.epochs.value_or(0)));
  file.set("training", "batch", static_cast<std::int64_t>(m.fit.batch.value_or(0)));
  file.set("training", "patience", static_cast<std::int64_t>(m.fit.patience.value_or(0)));
  file.set("training", "learning_rate", m.fit.learning_rate.value_or(0));
  file.set("training", "weight_decay", m.fit.weight_decay.value_or(0));
}

void save_body(H5File& file, const TrainedModel& m) {
  save_axis(file, m.features.spd_axis);
  save_axis(file, m.features.radar_axis);
  if (m.features.array_axis.count > 0) save_axis(file, m.features.array_axis);
  const auto flat = [&](const char* name, const auto& values) {
    file.write(name, values, {values.size()});
  };
  flat("features/centre", m.features.centre);
  file.set("features", "spd_gain", double{m.features.spd_gain});
  file.set("features", "radar_gain", double{m.features.radar_gain});
  flat("scene/background_m", m.scene.background);
  flat("scene/mean_map_m", m.scene.mean_map);
  file.write_texts("split/runs", m.seen.runs);
  flat("split/run", m.seen.run);
  flat("split/index", m.seen.index);
  flat("split/part", m.seen.part);
}

std::vector<float> load_map(const H5File& file, const std::string& name,
                            const record::MapGrid& grid) {
  auto map = file.read<float>(name, {grid.pixels()});
  for (const float depth : map)
    require_sound(file, depth >= 0 && depth <= farthest_m, name, "depths of 0 to 100 m");
  return map;
}

SeenRecords load_seen(const H5File& file) {
  SeenRecords seen;
  seen.runs = file.read_texts("split/runs");
  seen.run = file.read<std::uint32_t>("split/run", {H5File::any});
  seen.index = file.read<std::int64_t>("split/index", {seen.run.size()});
  seen.part = file.read<std::uint8_t>("split/part", {seen.run.size()});
  for (const std::uint32_t run : seen.run)
    require_sound(file, run < seen.runs.size(), "split/run", "numbers of its runs");
  for (const std::uint8_t part : seen.part)
    require_sound(file, part <= static_cast<std::uint8_t>(Part::test), "split/part", "0, 1 or 2");
  return seen;
}

void load_body(const H5File& file, TrainedModel& m) {
  m.features.spd_axis = load_axis(file, "spd");
  m.features.radar_axis = load_axis(file, "radar");
  if (file.has("axes/array")) m.features.array_axis = load_array_axis(file, m.features);
  m.features.centre = file.read<float>("features/centre", {m.features.count()});
  m.features.spd_gain = static_cast<float>(file.get<double>("features", "spd_gain"));
  m.features.radar_gain = static_cast<float>(file.get<double>("features", "radar_gain"));
  m.scene.background = load_map(file, "scene/background_m", m.scene.grid);
  m.scene.mean_map = load_map(file, "scene/mean_map_m", m.scene.grid);
  m.seen = load_seen(file);
  m.log.loss = file.read<double>("training/loss_m", {H5File::any});
  m.log.validation_loss = file.read<double>("training/validation_loss_m", {m.log.loss.size()});
  m.log.best_epoch = load_count<std::size_t>(file, "training", "best_epoch");
}

void check_format(const H5File& file) {
  if (!file.has_attribute(".", "format") || file.get<std::string>(".", "format") != format)
    file.refuse(".@format", std::string("expected \"") + format + "\": this is no model file");
  const auto found = file.get<std::int64_t>(".", "format_version");
  if (found < oldest_version || found > format_version)
    file.refuse(
        ".@format_version",
        "is " + std::to_string(found) + "; expected " + std::to_string(format_version) +
            (found > format_version ? ": use a newer echofuse" : ": train the model again"));
}

void save_to(H5File& file, const TrainedModel& model) {
  save_head(file, model);
  save_body(file, model);
  save_training(file, model);
  if (model.alignment.known()) model.alignment.save(file);
  model.context.save(file);
  model.model->save(file);
  model.range_bias.save(file);
  model.domain.save(file);
  if (model.uncertainty) model.uncertainty->save(file);
  if (!model.fallback) return;
  H5File group = file.group(fallback_group);
  save_to(group, *model.fallback);
}

TrainedModel load_one(const H5File& file) {
  TrainedModel out;
  load_head(file, out);
  load_body(file, out);
  const Layout layout = out.features.layout();
  const bool aligned = wants_alignment(out.name);
  require_sound(file, !aligned || (layout.spd.count > 0 && layout.radar.count > 0), ".@inputs",
                "fused: this kind of model needs both sensors");
  const bool uncertainties = file.has("uncertainty");
  if (aligned || file.has("range_bias") ||
      ((uncertainties || file.has("domain")) && layout.spd.count > 0))
    out.alignment.load(file, layout);
  out.model = kind_of(out.name).make();
  out.context.load(file);
  out.model->load(file, aligned ? out.context.size() + out.alignment.inputs() : layout.inputs(),
                  out.scene.grid.pixels());
  out.range_bias.load(file, out.alignment);
  out.domain.load(file, out.features.inputs);
  if (uncertainties) out.uncertainty.emplace().load(file, out.features, out.alignment);
  return out;
}

// It answers for records of the model's own axes, in the same words, and takes less than the model:
// so a chain of them ends.
void check_fallback(const H5File& file, const TrainedModel& model) {
  const TrainedModel& other = *model.fallback;
  const std::string name = fallback_group;
  const bool of_antennas = model.features.array_axis.count > 0;
  const bool of_profile = other.features.inputs == Inputs::fused_profile;
  require_sound(file, both_sensors(model.features.inputs), name, "none but in a fused model");
  require_sound(file, other.features.inputs == Inputs::spd || (of_profile && of_antennas),
                name + "@inputs", of_antennas ? "spd or fused-profile" : "spd");
  require_sound(file, same_axis(other.features.spd_axis, model.features.spd_axis),
                name + "/axes/spd", "the model's own");
  require_sound(file,
                !of_profile || same_axis(other.features.radar_axis, model.features.radar_axis),
                name + "/axes/radar", "the model's own");
  require_sound(file, other.scene.grid == model.scene.grid, name + "@map_size", "the model's own");
  require_sound(file, other.uncertainty.has_value() == model.uncertainty.has_value(),
                name + "/uncertainty", "one as the model has, or none as it has none");
  require_sound(file, of_profile || !file.has(name + "/" + fallback_group), name,
                "no fallback of its own");
}

void load_fallbacks(const H5File& file, TrainedModel& model) {
  if (!file.has(fallback_group)) return;
  const H5File group = file.group(fallback_group);
  model.fallback = std::make_unique<TrainedModel>(load_one(group));
  check_fallback(file, model);
  load_fallbacks(group, *model.fallback);
}

// False with errno. A file system that cannot do it in one step does it in two.
bool rename_to(const std::string& from, const std::string& to, Existing existing) {
  if (existing == Existing::replace) return std::rename(from.c_str(), to.c_str()) == 0;
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return true;
  if (errno != EINVAL && errno != ENOSYS) return false;
  if (::access(to.c_str(), F_OK) == 0) return errno = EEXIST, false;
  return std::rename(from.c_str(), to.c_str()) == 0;
}

}  // namespace

void check_can_save(const std::string& path, Existing existing) {
  // A run that is given for OUT by mistake must not become a model.
  if (std::filesystem::exists(path)) {
    try {
      check_format(H5File::open_sealed(path));
    } catch (const Error&) {
      throw Error(ExitCode::usage,
                  path + ": exists and is no model file of this version; give another --out");
    }
    if (existing == Existing::keep)
      throw Error(ExitCode::usage,
                  path + ": is a model already; give another --out, or --force to replace it");
  }
  const std::string unfinished = path + ".part";
  write_file(unfinished, {});
  std::remove(unfinished.c_str());
}

void save_model(const TrainedModel& model, const std::string& path, Existing existing) {
  const std::string unfinished = path + ".part";
  std::remove(unfinished.c_str());
  H5File file = H5File::create_sealed(unfinished);
  save_to(file, model);
  file.close();
  if (rename_to(unfinished, path, existing)) return;
  const bool there = errno == EEXIST;
  throw Error(there ? ExitCode::failed : ExitCode::disk,
              path +
                  (there ? ": was made by somebody else meanwhile; what was to be there is in "
                         : ": cannot rename to it ") +
                  unfinished);
}

TrainedModel load_model(const H5File& file) {
  check_format(file);
  TrainedModel out = load_one(file);
  load_fallbacks(file, out);
  return out;
}

TrainedModel load_model(const std::string& path) {
  if (::access(path.c_str(), R_OK) != 0)
    throw Error(ExitCode::failed, path + ": no such file, or not readable; expected a model file");
  return load_model(H5File::open_sealed(path));
}

}  // namespace echofuse::recon
