// SPDX-License-Identifier: MIT
#include <unistd.h>

#include <cstdio>
#include <filesystem>

#include "drivers/core/console.hpp"
#include "recon/files.hpp"
#include "recon/models/checkpoint.hpp"
#include "recon/trained_model.hpp"

namespace echofuse::recon {
namespace {

using record::H5File;

constexpr const char* format = "echofuse model";
constexpr std::int64_t format_version = 1;
constexpr const char* fallback_group = "fallback";

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
  return {name,
          file.get<std::string>(group, "quantity"),
          file.get<std::string>(group, "unit"),
          static_cast<std::uint32_t>(file.get<std::int64_t>(group, "count")),
          file.get<double>(group, "start"),
          file.get<double>(group, "step"),
          file.get<double>(group, "scale")};
}

void save_head(H5File& file, const TrainedModel& m) {
  file.set(".", "format", std::string(format));
  file.set(".", "format_version", format_version);
  file.set(".", "model", m.name);
  file.set(".", "inputs", std::string(name_of(m.features.inputs)));
  file.set(".", "scaling", m.features.scaling);
  file.set(".", "version", std::string(version()));
  file.set(".", "data_crc32c", std::int64_t{m.data_hash});
  file.set(".", "train_s", m.train_s);
  file.set(".", "foreground_depth_m", double{m.scene.foreground_depth_m});
  file.set(".", "split", m.split.kind);
  file.set(".", "gap", static_cast<std::int64_t>(m.split.gap));
  file.set(".", "seed", static_cast<std::int64_t>(m.split.seed));
  file.set(".", "test_share", m.split.test_share);
  file.set(".", "validation_share", m.split.validation_share);
}

void load_head(const H5File& file, TrainedModel& m) {
  m.name = file.get<std::string>(".", "model");
  m.features.inputs = inputs_of(file.get<std::string>(".", "inputs"));
  m.features.scaling = file.get<std::string>(".", "scaling");
  m.data_hash = static_cast<std::uint32_t>(file.get<std::int64_t>(".", "data_crc32c"));
  m.train_s = file.get<double>(".", "train_s");
  m.scene.foreground_depth_m = static_cast<float>(file.get<double>(".", "foreground_depth_m"));
  m.split.kind = file.get<std::string>(".", "split");
  m.split.gap = static_cast<std::size_t>(file.get<std::int64_t>(".", "gap"));
  m.split.seed = static_cast<std::uint64_t>(file.get<std::int64_t>(".", "seed"));
}

void save_training(H5File& file, const TrainedModel& m) {
  file.write("training/loss_m", m.log.loss, {m.log.loss.size()});
  file.write("training/validation_loss_m", m.log.validation_loss, {m.log.validation_loss.size()});
  const auto widths = m.fit.hidden.value_or(std::vector<std::size_t>{});
  const std::vector<std::uint64_t> hidden(widths.begin(), widths.end());
  file.write("training/hidden", hidden, {hidden.size()});
  file.set("training", "best_epoch", static_cast<std::int64_t>(m.log.best_epoch));
  file.set("training", "epochs", static_cast<std::int64_t>(m.fit.epochs.value_or(0)));
  file.set("training", "batch", static_cast<std::int64_t>(m.fit.batch));
  file.set("training", "patience", static_cast<std::int64_t>(m.fit.patience.value_or(0)));
  file.set("training", "learning_rate", m.fit.learning_rate.value_or(0));
  file.set("training", "weight_decay", m.fit.weight_decay.value_or(0));
}

void save_body(H5File& file, const TrainedModel& m) {
  save_axis(file, m.features.spd_axis);
  save_axis(file, m.features.radar_axis);
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

void load_body(const H5File& file, TrainedModel& m) {
  m.features.spd_axis = load_axis(file, "spd");
  m.features.radar_axis = load_axis(file, "radar");
  m.features.centre = file.read<float>("features/centre");
  m.features.spd_gain = static_cast<float>(file.get<double>("features", "spd_gain"));
  m.features.radar_gain = static_cast<float>(file.get<double>("features", "radar_gain"));
  m.scene.background = file.read<float>("scene/background_m");
  m.scene.mean_map = file.read<float>("scene/mean_map_m");
  m.seen.runs = file.read_texts("split/runs");
  m.seen.run = file.read<std::uint32_t>("split/run");
  m.seen.index = file.read<std::int64_t>("split/index");
  m.seen.part = file.read<std::uint8_t>("split/part");
  m.log.loss = file.read<double>("training/loss_m");
  m.log.validation_loss = file.read<double>("training/validation_loss_m");
  m.log.best_epoch = static_cast<std::size_t>(file.get<std::int64_t>("training", "best_epoch"));
}

void check_format(const H5File& file, const std::string& path) {
  if (!file.has_attribute(".", "format") || file.get<std::string>(".", "format") != format)
    throw Error(ExitCode::failed, path + ": not an echofuse model file");
  const auto found = file.get<std::int64_t>(".", "format_version");
  if (found > format_version)
    throw Error(ExitCode::failed, path + ": model format " + std::to_string(found) +
                                      " is newer than this program's " +
                                      std::to_string(format_version) + "; use a newer echofuse");
}

void save_to(H5File& file, const TrainedModel& model) {
  save_head(file, model);
  save_body(file, model);
  save_training(file, model);
  model.model->save(file);
  model.slip.save(file);
  if (model.confidence) model.confidence->save(file);
  if (!model.fallback) return;
  H5File group = file.group(fallback_group);
  save_to(group, *model.fallback);
}

TrainedModel load_from(const H5File& file) {
  TrainedModel out;
  load_head(file, out);
  load_body(file, out);
  out.model = make_model(out.name);
  out.model->load(file);
  out.slip.load(file);
  if (file.has("confidence")) out.confidence.emplace().load(file, out.features);
  if (file.has(fallback_group))
    out.fallback = std::make_unique<TrainedModel>(load_from(file.group(fallback_group)));
  return out;
}

}  // namespace

void check_can_save(const std::string& path) {
  // A run that is given for OUT by mistake must not become a model.
  if (std::filesystem::exists(path)) try {
      check_format(H5File::open(path), path);
    } catch (const Error&) {
      throw Error(ExitCode::usage, path + ": exists and is no model file; give another --out");
    }
  const std::string unfinished = path + ".part";
  write_file(unfinished, {});
  std::remove(unfinished.c_str());
}

void save_model(const TrainedModel& model, const std::string& path) {
  write_whole(path, [&](H5File& file) { save_to(file, model); });
}

TrainedModel load_model(const std::string& path) {
  if (::access(path.c_str(), R_OK) != 0)
    throw Error(ExitCode::failed, path + ": no such file, or not readable; expected a model file");
  const H5File file = H5File::open(path);
  check_format(file, path);
  return load_from(file);
}

}  // namespace echofuse::recon
