// SPDX-License-Identifier: MIT
#include "sim/devices/faults.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "sim/scene/toml_tables.hpp"

namespace echofuse::sim {
namespace {

struct FaultRule {
  const char* name;
  double usual, min, max;  // default and range of Fault::amount
};
constexpr std::array<FaultRule, 10> kinds = {{{"drop", 1, 0, 1},
                                              {"corrupt", 1, 0, 1},
                                              {"stall", 0, 0, 0},
                                              {"late", 0.05, 0, 10},
                                              {"unplug", 0, 0, 0},
                                              {"garbage", 64, 1, 65536},
                                              {"clock_drift", 200, -1e5, 1e5},
                                              {"clock_offset", 0.5, -1e4, 1e4},
                                              {"gain", 0.5, 0, 100},
                                              {"freeze", 0, 0, 0}}};
constexpr FaultRule noisy_frames = {"garbage", 1, 0, 1};
const char* const devices[] = {"tdc", "radar", "depth"};
const char* const keys[] = {"device", "at_s", "for_s", "every_s", "kind", "amount"};
constexpr double longest_s = 1e7;

template <class List>
std::string listed(const List& names) {
  std::string text;
  for (const auto& n : names) {
    if (!text.empty()) text += ", ";
    text += n;
  }
  return text;
}

std::string shown(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

class FaultReader : TableReader {
 public:
  using TableReader::TableReader;

  std::vector<Fault> read(const std::string& text) {
    std::vector<Fault> all;
    read_tables(text, "fault", [&](const toml::table& table) { all.push_back(read_one(table)); });
    refuse_faults();
    return all;
  }

 private:
  Fault read_one(const toml::table& table) {
    for (const auto& [key, node] : table)
      if (std::find(std::begin(keys), std::end(keys), key.str()) == std::end(keys))
        say(node, std::string(key.str()) + ": unknown key; expected " + listed(keys));
    Fault fault;
    fault.device = text(table, "device", {devices[0], devices[1], devices[2]});
    std::vector<std::string> names;
    for (const FaultRule& k : kinds) names.emplace_back(k.name);
    const std::string kind = text(table, "kind", names);
    const auto found = std::find(names.begin(), names.end(), kind);
    if (found == names.end()) return fault;
    fault.kind = static_cast<FaultKind>(found - names.begin());
    fault.at_s = number(table, "at_s", {}, 0, longest_s);
    fault.for_s = number(table, "for_s", {}, 0, longest_s);
    fault.every_s = number(table, "every_s", 0, 0, longest_s);
    if (fault.every_s > 0 && fault.every_s < fault.for_s)
      say(table, "every_s is shorter than for_s: the fault would overlap itself");
    const bool camera = fault.device == "depth";
    if (camera && fault.kind == FaultKind::gain)
      say(table, "a depth camera has no gain; expected another kind or device");
    if (fault.device == "tdc" && fault.kind == FaultKind::freeze)
      say(table, "a time tagger has no frame to freeze; expected radar or depth");
    const FaultRule& limits = camera && fault.kind == FaultKind::garbage
                                  ? noisy_frames
                                  : kinds[static_cast<std::size_t>(fault.kind)];
    if (limits.max > limits.min)
      fault.amount = number(table, "amount", limits.usual, limits.min, limits.max);
    else if (const auto* given = table.get("amount"))
      say(*given, kind + " takes no amount; remove it");
    return fault;
  }

  std::string text(const toml::table& table, const char* key,
                   const std::vector<std::string>& allowed) {
    const auto* node = table.get(key);
    const auto value = node ? node->value_exact<std::string>() : std::nullopt;
    if (value && std::find(allowed.begin(), allowed.end(), *value) != allowed.end()) return *value;
    const std::string expected = std::string(key) + ": expected one of " + listed(allowed);
    node ? say(*node, expected) : say(table, expected);
    return {};
  }

  double number(const toml::table& table, const char* key, std::optional<double> usual, double min,
                double max) {
    const auto* node = table.get(key);
    if (!node && usual) return *usual;
    const bool numeric = node && (node->is_integer() || node->is_floating_point());
    const double value = numeric ? node->value<double>().value_or(NAN) : NAN;
    if (value >= min && value <= max) return value;
    const std::string expected =
        std::string(key) + ": expected a number from " + shown(min) + " to " + shown(max);
    node ? say(*node, expected) : say(table, expected);
    return 0;
  }
};

// Returns the number of repetitions completed before `time_s`, and the time in seconds since the
// start of the current repetition. Returns an empty value before the first start.
std::optional<std::pair<double, double>> progress(const Fault& f, double time_s) {
  if (time_s < f.at_s) return {};
  const double since = time_s - f.at_s;
  const double n = f.every_s > 0 ? std::floor(since / f.every_s) : 0;
  return std::pair(n, since - n * f.every_s);
}

}  // namespace

const char* name_of(FaultKind kind) { return kinds[static_cast<std::size_t>(kind)].name; }

std::vector<Fault> read_faults(const std::string& text, const std::string& name) {
  return FaultReader(name).read(text);
}

Faults::Faults(const std::vector<Fault>& all, const std::string& device) {
  std::copy_if(all.begin(), all.end(), std::back_inserter(faults_),
               [&](const Fault& f) { return f.device == device; });
}

std::optional<double> Faults::at(FaultKind kind, double time_s) const {
  return segment(time_s).amounts[static_cast<std::size_t>(kind)];
}

bool Faults::any_at(double time_s) const {
  const auto& amounts = segment(time_s).amounts;
  return std::any_of(amounts.begin(), amounts.end(), [](const auto& a) { return a.has_value(); });
}

double Faults::next_change_s(double time_s) const { return segment(time_s).to_s; }

double Faults::clock_error_s(double time_s) const {
  const Segment& at = segment(time_s);
  return at.error_s + at.slope * (time_s - at.from_s);
}

const Faults::Segment& Faults::segment(double time_s) const {
  if (!(time_s >= segment_.from_s && time_s < segment_.to_s)) segment_ = segment_at(time_s);
  return segment_;
}

Faults::Segment Faults::segment_at(double time_s) const {
  Segment out{-1e12, std::numeric_limits<double>::infinity()};
  const auto between = [&](double from_s, double to_s) {
    out.from_s = std::max(out.from_s, from_s), out.to_s = std::min(out.to_s, to_s);
  };
  double drift_to_now_s = 0;
  for (const Fault& f : faults_) {
    const bool drifts = f.kind == FaultKind::clock_drift;
    const bool shifts = f.kind == FaultKind::clock_offset;
    const auto p = progress(f, time_s);
    if (!p) {
      between(out.from_s, f.at_s);
      continue;
    }
    const auto [before, now] = *p;
    const double start_s = f.at_s + before * f.every_s, end_s = start_s + f.for_s;
    const bool acts = now < f.for_s;
    if (acts)
      between(start_s, end_s);
    else
      between(end_s, f.every_s > 0 ? start_s + f.every_s : out.to_s);
    if (auto& amount = out.amounts[static_cast<std::size_t>(f.kind)]; acts && !amount)
      amount = f.amount;
    if (acts && shifts) out.error_s += f.amount;
    if (drifts) drift_to_now_s += f.amount * 1e-6 * (before * f.for_s + std::min(now, f.for_s));
    if (drifts && acts) out.slope += f.amount * 1e-6;
  }
  out.error_s += drift_to_now_s - out.slope * (time_s - out.from_s);
  return out;
}

std::vector<Faults::FaultChange> Faults::changes(double from_s, double to_s) const {
  std::vector<FaultChange> all;
  const auto add = [&](double time_s, const Fault& f, bool begins) {
    if (time_s > from_s && time_s <= to_s) all.push_back({time_s, &f, begins});
  };
  for (const Fault& f : faults_) {
    const auto last = progress(f, to_s);
    if (!last) continue;
    const auto first = progress(f, from_s);
    for (double n = first ? first->first : 0; n <= last->first; ++n) {
      add(f.at_s + n * f.every_s, f, true);
      add(f.at_s + n * f.every_s + f.for_s, f, false);
    }
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const FaultChange& a, const FaultChange& b) { return a.time_s < b.time_s; });
  return all;
}

}  // namespace echofuse::sim
