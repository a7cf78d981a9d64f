// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/data/dataset.hpp"
#include "recon/data/lags.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

std::string describe(const Axis& a) {
  if (a.count == 0) return "none";
  return std::to_string(a.count) + " x " + std::to_string(a.step) + " " + printable(a.unit, 20) +
         " from " + std::to_string(a.start) + " " + printable(a.unit, 20) + " (" +
         printable(a.quantity, 20) + ")";
}

// Describes how the zones differ; empty if they agree.
std::string difference(const Zones& found, const Zones& expected) {
  if (found.size() != expected.size())
    return format("%zu zones, expected %zu", found.size(), expected.size());
  const auto [a, b] = std::ranges::mismatch(found, expected, same_view);
  if (a == found.end()) return {};
  const auto known = [](const Zone& zone) { return zone.has_direction() ? "known" : "unknown"; };
  if (a->has_direction() != b->has_direction())
    return format("the directions of the zones are %s, expected %s", known(*a), known(*b));
  if (same_view({b->x, b->y, a->width}, *a))
    return format("zone %td has width %.2f (tangents), expected %.2f", a - found.begin(), a->width,
                  b->width);
  return format(
      "zone %td is at x %.2f, y %.2f (tangents), expected x %.2f, y %.2f; are the zones in another "
      "order?",
      a - found.begin(), a->x, a->y, b->x, b->y);
}

// Describes how the axes differ if is_near() returned false.
std::string difference(const ColumnAxis& found, const ColumnAxis& expected) {
  if (found.count == 0 || expected.count == 0) return "one of the two axes is missing";
  if (found.quantity != expected.quantity || found.unit != expected.unit)
    return "quantity or unit differs";
  if (found.scale != expected.scale)
    return format("scale is %.4g, expected %.4g", found.scale, expected.scale);
  std::string out;
  const auto add = [&](const std::string& text) { out += (out.empty() ? "" : "; ") + text; };
  const auto off = [&](std::uint32_t i) { return std::abs(found.at(i) - expected.at(i)); };
  const double limit = std::abs(expected.step);
  if (off(0) > limit) add(format("start differs by %.4g bins (limit 1)", off(0) / limit));
  if (const double drift = expected.count * std::abs(found.step - expected.step); drift > limit)
    add(format("step differs: %.4g bins at the end of the axis (limit 1)", drift / limit));
  if (found.count < expected.count)
    add(format("too short: %u bins, expected %u", found.count, expected.count));
  if (const std::string zones = difference(found.zones, expected.zones); !zones.empty()) add(zones);
  return out.empty() ? format("end differs by %.4g bins (limit 1)", off(expected.count) / limit)
                     : out;
}

// Returns true if `expected` is identical to `found` or to the first part of `found`.
bool covers(ColumnAxis found, const ColumnAxis& expected) {
  found.count = std::min(found.count, expected.count);
  return agree(found, expected);
}

void match(const Dataset& data, Column& column, const ColumnAxis& expected,
           const std::string& owner) {
  if (agree(column.axis, expected)) return;
  if (!is_near(column.axis, expected)) throw axis_error(data.path(), column.axis, expected, owner);
  Matrix out(0, expected.size());
  for (std::size_t row = 0; row < column.rows; ++row)
    out.add_row(resampled(column.row(row), column.axis, expected));
  column = std::move(out), column.axis = expected;
}

void sum_zones(Dataset& data) {
  Column& spd = data.spd();
  if (spd.axis.zones.size() == 1) return;
  Matrix out(0, spd.axis.count);
  for (std::size_t row = 0; row < spd.rows; ++row) out.add_row(counts_of(data, row));
  spd = std::move(out), spd.axis.zones = single_pixel();
}

}  // namespace

Error axis_error(const std::string& path, const ColumnAxis& found, const ColumnAxis& expected,
                 const std::string& reference) {
  return {ExitCode::failed, printable(path) + ": " + expected.name + " axis is " + describe(found) +
                                ", " + reference + " is " + describe(expected) + ": " +
                                difference(found, expected)};
}

std::vector<float> resampled(std::span<const float> row, const ColumnAxis& found,
                             const ColumnAxis& expected) {
  const std::size_t values = expected.values_per_bin();
  const bool cropped = covers(found, expected);
  std::vector<float> out;
  out.reserve(expected.size());
  for (; out.size() < expected.size(); row = row.subspan(found.zone_size()))
    for (std::uint32_t j = 0; j < expected.count; ++j) {
      const double place = cropped ? j
                                   : std::clamp((expected.at(j) - found.start) / found.step, 0.0,
                                                static_cast<double>(found.count - 1));
      const auto i = static_cast<std::size_t>(place);
      const std::size_t next = std::min<std::size_t>(i + 1, found.count - 1);
      const auto part = static_cast<float>(place - static_cast<double>(i));
      for (std::size_t k = 0; k < values; ++k)
        out.push_back((1 - part) * row[i * values + k] + part * row[next * values + k]);
    }
  return out;
}

bool agree(const ColumnAxis& a, const ColumnAxis& b) {
  if (a.count != b.count || a.count == 0) return a.count == b.count;
  ColumnAxis other = b;
  other.zones = a.zones;
  return same_axis(a, other) && std::ranges::equal(a.zones, b.zones, same_view);
}

bool is_near(const ColumnAxis& found, const ColumnAxis& expected) {
  const auto off = [&](std::uint32_t i) { return std::abs(found.at(i) - expected.at(i)); };
  return found.quantity == expected.quantity && found.unit == expected.unit &&
         found.scale == expected.scale && found.count >= expected.count &&
         off(0) <= std::abs(expected.step) && off(expected.count) <= std::abs(expected.step) &&
         std::ranges::equal(found.zones, expected.zones, same_view);
}

void archive_axis(Archive archive, Axis& axis) {
  constexpr std::int64_t max_bins = 1 << 20;
  archive.text("quantity", axis.quantity, {});
  archive.text("unit", axis.unit, {});
  archive.count("count", axis.count, 0, max_bins);
  archive.number("start", axis.start, -1e9, 1e9);
  archive.number("step", axis.step, axis.count > 0 ? 1e-9 : -1e9, 1e9);
  archive.number("scale", axis.scale, -1e9, 1e9);
}

// A single pixel has no zones in the file. The directions and widths of the zones are stored if
// they are all known.
void archive_zones(Archive archive, Zones& zones) {
  std::size_t count = zones.size() > 1 ? zones.size() : 0;
  archive.count("zones", count, 0, static_cast<std::int64_t>(max_zones));
  zones.resize(std::max<std::size_t>(count, 1));
  const bool known = count > 0 && std::ranges::all_of(zones, &Zone::has_direction);
  if (!archive.part("knows_directions", known)) return;
  constexpr std::array members{&Zone::x, &Zone::y, &Zone::width};
  Matrix views(count, members.size());
  for (std::size_t z = 0; z < count; ++z)
    for (std::size_t k = 0; k < members.size(); ++k)
      views.row(z)[k] = static_cast<float>(zones[z].*members[k]);
  archive.table("zone_views", views, count, members.size());
  for (std::size_t z = 0; z < count; ++z)
    for (std::size_t k = 0; k < members.size(); ++k) zones[z].*members[k] = double{views.row(z)[k]};
}

Axis radar_bins(double width_m) {
  constexpr double span_m = 7;
  const auto count = static_cast<std::uint32_t>(span_m / width_m + 1e-9);
  return range_axis("binned_power", count, width_m / 2, width_m);
}

void rebin_radar(Dataset& data, const Axis& bins) {
  Column& radar = data.radar();
  const Axis& from = radar.axis;
  if (from.quantity != "power" || from.step > bins.step ||
      from.at(from.count - 0.5) < bins.at(bins.count - 0.5))
    throw Error(ExitCode::failed, data.path() + ": the radar axis is " + describe(from) +
                                      "; it cannot be summed into bins of " + describe(bins));
  // Converts index i of the profile to a position in the new bins; bin j covers [j, j + 1].
  const auto edge = [&](double i) { return (from.at(i) - bins.at(-0.5)) / bins.step; };
  const double width = from.step / bins.step;
  Matrix table(data.size(), bins.count);
  std::vector<double> sums(bins.count);
  for (std::size_t row = 0; row < data.size(); ++row) {
    if (all_same(radar.row(row))) {
      std::fill_n(table.row(row).begin(), bins.count, radar.row(row)[0]);
      continue;
    }
    std::fill(sums.begin(), sums.end(), 0.0);
    for (std::uint32_t i = 0; i < from.count; ++i) {
      const double power = radar.row(row)[i], end = std::max(edge(i + 0.5), 0.0);
      const double begin = std::min(edge(i - 0.5), end), bin = std::floor(end);
      const double share = std::clamp((end - std::max(bin, begin)) / width, 0.0, 1.0);
      if (bin < bins.count) sums[static_cast<std::size_t>(bin)] += power * (bin > 0 ? share : 1);
      if (bin > 0 && bin <= bins.count)
        sums[static_cast<std::size_t>(bin) - 1] += power * (1 - share);
    }
    std::copy(sums.begin(), sums.end(), table.row(row).begin());
  }
  radar = std::move(table), radar.axis = bins;
  drop_array(data);
}

void match_axes(Dataset& data, const Layout& expected, Inputs inputs, const std::string& owner) {
  const SensorSet sensors = sensors_of(inputs);
  if (sensors.contains(Sensor::spd)) {
    if (expected.spd.zones.size() == 1) sum_zones(data);
    match(data, data.spd(), expected.spd, owner);
  }
  if (sensors.contains(Sensor::radar)) {
    if (expected.radar.quantity == "binned_power" && data.radar().axis.quantity == "power")
      rebin_radar(data, expected.radar);
    match(data, data.radar(), expected.radar, owner);
  }
  if (inputs != Inputs::fused || expected.array.count == 0) return drop_array(data);
  if (data.array().axis.count == 0)
    throw Error(
        ExitCode::failed,
        printable(data.path()) +
            ": contains no radar antenna samples, which the model needs; for such runs train a "
            "model with --inputs fused-profile");
  match(data, data.array(), expected.array, owner);
}

void archive(Archive archive, Layout& axes) {
  auto& [spd, radar, array] = axes;
  spd.name = "spd", radar.name = "radar", array.name = "array";
  archive_axis(archive.in("axes/spd"), spd);
  archive_axis(archive.in("axes/radar"), radar);
  archive_zones(archive, spd.zones);
  if (!archive.part("takes_antennas", array.count > 0)) return;
  archive_axis(archive.in("axes/array"), array);
  const double lags = array.scale;
  archive.require(array.count > 0 && lags >= 1 && lags <= double{2 * max_lags} &&
                      lags == std::floor(lags) && static_cast<double>(lags_up(array)) < lags,
                  "axes/array/scale",
                  "expected 1 to 32 lags, at least one with a horizontal component");
}

}  // namespace echofuse::recon
