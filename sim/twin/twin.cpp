// SPDX-License-Identifier: MIT
#include "sim/twin/twin.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>

#include "drivers/core/random.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/program.hpp"
#include "sim/scene/draw.hpp"
#include "sim/scene/toml_tables.hpp"

namespace echofuse::sim {
namespace {

// Settings that cannot have a range, because the run file contains only one value of each setting.
constexpr std::array stated{"bin_width_ps",     "first_bin_ps", "radar_step_m",
                            "half_tangent",     "baseline_m",   "radar_resolution_m",
                            "map_half_tangent", "map_z_max_m"};

std::string number_text(double value) {
  const std::string text = format("%.17g", value);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}

// Returns the error message for a value outside the limits of a setting; empty if the value is
// valid.
std::optional<std::string> fault_of(const std::string& key, double value) {
  Conditions conditions;
  Settings settings;
  bind(settings, conditions);
  const auto faults = settings.read(key + " = " + number_text(value) + "\n", "", {});
  if (faults.empty()) return {};
  const auto place = faults.front().find(": ");
  return place == std::string::npos ? faults.front() : faults.front().substr(place + 2);
}

class TwinReader : TableReader {
 public:
  using TableReader::TableReader;

  Twin read(const std::string& text) try {
    Twin twin;
    for (const auto& [key, node] : toml::parse(text, name_)) {
      if (key.str() == "seed" && node.is_integer() && node.value<std::int64_t>() >= 0)
        twin.seed = *node.value<std::int64_t>();
      else if (const auto range = range_of(std::string(key.str()), node))
        twin.ranges.push_back(*range);
    }
    refuse_faults();
    return twin;
  } catch (const toml::parse_error& e) {
    refuse({place(e) + "not TOML: " + std::string(e.description())});
  }

 private:
  std::optional<KeyRange> range_of(const std::string& key, const toml::node& node) {
    const auto say = [&](const std::string& what) {
      TableReader::say(node, what);
      return std::optional<KeyRange>{};
    };
    const toml::array* list = node.as_array();
    const auto number = [&](std::size_t i) {
      return list->get(i)->is_number() ? list->get(i)->value<double>().value_or(NAN) : NAN;
    };
    if (list == nullptr || list->size() < 2 || list->size() > 3)
      return say(key + (key == "seed" ? ": expected a whole number of at least 0"
                                      : ": expected [low, high] or [low, high, \"log\"]"));
    KeyRange range{key, number(0), number(1), list->size() == 3};
    if (range.logarithmic && list->get(2)->value<std::string>() != "log")
      return say(key + ": expected nothing or \"log\" after low and high");
    if (!(range.low <= range.high)) return say(key + ": expected low and high in ascending order");
    if (range.logarithmic && range.low <= 0)
      return say(key + ": \"log\" requires a low limit above 0");
    if (std::find(stated.begin(), stated.end(), key) != stated.end())
      return say(key +
                 ": cannot have a range, because the run file contains its value; use an error "
                 "(baseline_error_m, radar_psf_width, spd_field) instead");
    for (const double end : {range.low, range.high})
      if (const auto fault = fault_of(key, end)) return say(*fault);
    return range;
  }
};

// Returns the 64-bit FNV-1a hash of a string.
std::uint64_t hash(std::string_view text) {
  std::uint64_t h = 0xcbf29ce484222325ULL;
  for (const char c : text) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  return h;
}

double draw(const KeyRange& range, std::int64_t seed, std::int64_t laboratory) {
  Rng rng = make_rng(mix(static_cast<std::uint64_t>(seed)) ^ hash(range.key),
                     static_cast<std::uint64_t>(laboratory));
  if (!range.logarithmic) return uniform(rng, range.low, range.high);
  return std::clamp(std::exp(uniform(rng, std::log(range.low), std::log(range.high))), range.low,
                    range.high);
}

}  // namespace

Twin read_twin(const std::string& text, const std::string& name) {
  return TwinReader(name).read(text);
}

std::string to_text(const Twin& twin) {
  std::string out = "seed = " + std::to_string(twin.seed) + "\n";
  for (const KeyRange& r : twin.ranges)
    out += r.key + " = [" + number_text(r.low) + ", " + number_text(r.high) +
           (r.logarithmic ? ", \"log\"]\n" : "]\n");
  return out;
}

std::string default_twin() { return read_config_text(data_folder() / "twin.toml"); }

Twin twin_named(const std::string& name) {
  if (name == "default") return read_twin(default_twin(), "the default twin");
  if (name.find('=') != std::string::npos) return read_twin(name, "twin");
  return read_twin(read_config_text(name), name);
}

std::string draws_of(const Twin& twin, std::int64_t laboratory) {
  std::string out;
  for (const KeyRange& r : twin.ranges)
    out += r.key + " = " + number_text(draw(r, twin.seed, laboratory)) + "\n";
  return out;
}

Conditions conditions_of(const Twin& twin, std::int64_t laboratory, const Conditions& nominal) {
  Conditions drawn = nominal;
  Settings settings;
  bind(settings, drawn);
  settings.read_text(draws_of(twin, laboratory), "laboratory " + std::to_string(laboratory));
  validate(drawn);
  return drawn;
}

}  // namespace echofuse::sim
