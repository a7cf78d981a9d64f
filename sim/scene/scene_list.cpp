// SPDX-License-Identifier: MIT
#include "sim/scene/scene_list.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "sim/scene/toml_tables.hpp"

namespace echofuse::sim {
namespace {

constexpr std::int64_t max_scenes = 10'000'000;

class SceneListReader : TableReader {
 public:
  using TableReader::TableReader;

  std::vector<SceneSpec> read(const std::string& text) {
    std::vector<SceneSpec> all;
    read_tables(text, "scene", [&](const toml::table& table) { read_one(table, all); });
    if (all.empty() && faults_.empty()) faults_.push_back(name_ + ": contains no [[scene]] table");
    refuse_faults();
    return all;
  }

 private:
  void read_one(const toml::table& table, std::vector<SceneSpec>& all) {
    SceneSpec spec;
    std::int64_t count = 1;
    bool has_kind = false;
    for (const auto& [key, node] : table) {
      const std::string_view name = key.str();
      if (name == "kind") {
        const auto kind = kind_named(node.value<std::string>().value_or(""));
        if (kind) spec.kind = *kind;
        if (!kind) say(node, "kind: expected one of " + kind_names());
        has_kind = true;
      } else if (name == "count") {
        count = static_cast<std::int64_t>(number(node, "count", 1, 1e6).value_or(1));
        if (!node.is_integer()) say(node, "count: expected an integer");
      } else if (name == "x_m") {
        spec.x_m = number(node, "x_m", -20, 20);
      } else if (name == "z_m") {
        spec.z_m = number(node, "z_m", 0.2, 20);
      } else if (name == "yaw_deg") {
        spec.yaw_deg = number(node, "yaw_deg", -180, 180);
      } else {
        say(node, std::string(name) + ": unknown key; expected kind, count, x_m, z_m, yaw_deg");
      }
    }
    if (!has_kind) say(table, "kind is missing; expected one of " + kind_names());
    const bool placed = spec.kind == SceneKind::person || spec.kind == SceneKind::letter ||
                        spec.kind == SceneKind::object;
    if (!placed && (spec.x_m || spec.z_m || spec.yaw_deg))
      say(table, "x_m, z_m and yaw_deg are valid only for a person, letter or object");
    if (static_cast<std::int64_t>(all.size()) + count > max_scenes)
      return say(table, "more than 10 million scenes; reduce count");
    all.insert(all.end(), static_cast<std::size_t>(count), spec);
  }

  std::optional<double> number(const toml::node& node, const char* key, double min, double max) {
    const bool numeric = node.is_integer() || node.is_floating_point();
    const double value = numeric ? node.value<double>().value_or(NAN) : NAN;
    if (value >= min && value <= max) return value;
    say(node, std::string(key) + ": expected a number from " + std::to_string(min) + " to " +
                  std::to_string(max));
    return {};
  }
};

}  // namespace

std::vector<SceneSpec> read_scene_list(const std::string& text, const std::string& name) {
  return SceneListReader(name).read(text);
}

}  // namespace echofuse::sim
