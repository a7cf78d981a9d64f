// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>

#include "drivers/util/printable.hpp"
#include "recon/data/dataset.hpp"
#include "recon/data/lags.hpp"
#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

// Describes how the axes differ if is_near() returned false.
std::string difference(const Axis& found, const Axis& wanted) {
  if (found.count == 0 || wanted.count == 0) return "one of the two axes is missing";
  if (found.quantity != wanted.quantity || found.unit != wanted.unit)
    return "quantity or unit differs";
  if (found.scale != wanted.scale)
    return formatted("scale is %.4g, expected %.4g", found.scale, wanted.scale);
  std::string out;
  const auto add = [&](const std::string& text) { out += (out.empty() ? "" : "; ") + text; };
  const auto off = [&](std::uint32_t i) { return std::abs(found.at(i) - wanted.at(i)); };
  const double limit = std::abs(wanted.step);
  if (off(0) > limit) add(formatted("start differs by %.4g bins (limit 1)", off(0) / limit));
  if (const double drift = wanted.count * std::abs(found.step - wanted.step); drift > limit)
    add(formatted("step differs: %.4g bins at the end of the axis (limit 1)", drift / limit));
  if (found.count < wanted.count)
    add(formatted("too short: %u bins, expected %u", found.count, wanted.count));
  return out.empty() ? formatted("end differs by %.4g bins (limit 1)", off(wanted.count) / limit)
                     : out;
}

void resample(Matrix& table, const Axis& found, const Axis& wanted, std::size_t values_a_bin) {
  Matrix out(0, wanted.count * values_a_bin);
  for (std::size_t row = 0; row < table.rows; ++row)
    out.add_row(resampled(table.row(row), found, wanted, values_a_bin));
  table = std::move(out);
}

void resample_zones(Dataset& data, const Axis& wanted) {
  Matrix out(0, data.zones.size() * wanted.count);
  for (std::size_t row = 0; row < data.zone_spd.rows; ++row, ++out.rows)
    for (std::size_t z = 0; z < data.zones.size(); ++z) {
      const auto zone =
          data.zone_spd.row(row).subspan(z * data.spd_axis.count, data.spd_axis.count);
      const std::vector<float> values = resampled(zone, data.spd_axis, wanted, 1);
      out.values.insert(out.values.end(), values.begin(), values.end());
    }
  data.zone_spd = std::move(out);
}

}  // namespace

std::string describe(const Axis& a) {
  if (a.count == 0) return "none";
  return std::to_string(a.count) + " x " + std::to_string(a.step) + " " + printable(a.unit, 20) +
         " from " + std::to_string(a.start) + " " + printable(a.unit, 20) + " (" +
         printable(a.quantity, 20) + ")";
}

Error axis_error(const std::string& path, const Axis& found, const Axis& wanted,
                 const std::string& whose) {
  return {ExitCode::failed, printable(path) + ": " + wanted.name + " axis is " + describe(found) +
                                ", " + whose + " is " + describe(wanted) + ": " +
                                difference(found, wanted)};
}

std::vector<float> resampled(std::span<const float> row, const Axis& found, const Axis& wanted,
                             std::size_t values_a_bin) {
  std::vector<float> out(wanted.count * values_a_bin);
  for (std::uint32_t j = 0; j < wanted.count; ++j) {
    const double place = std::clamp((wanted.at(j) - found.start) / found.step, 0.0,
                                    static_cast<double>(found.count - 1));
    const auto i = static_cast<std::size_t>(place);
    const std::size_t next = std::min<std::size_t>(i + 1, found.count - 1);
    const auto part = static_cast<float>(place - static_cast<double>(i));
    for (std::size_t k = 0; k < values_a_bin; ++k)
      out[j * values_a_bin + k] =
          (1 - part) * row[i * values_a_bin + k] + part * row[next * values_a_bin + k];
  }
  return out;
}

bool is_near(const Axis& found, const Axis& wanted) {
  const auto off = [&](std::uint32_t i) { return std::abs(found.at(i) - wanted.at(i)); };
  return found.quantity == wanted.quantity && found.unit == wanted.unit &&
         found.scale == wanted.scale && found.count >= wanted.count &&
         off(0) <= std::abs(wanted.step) && off(wanted.count) <= std::abs(wanted.step);
}

bool covers(const Axis& found, const Axis& wanted) {
  Axis cropped = found;
  cropped.count = std::min(found.count, wanted.count);
  return agree(cropped, wanted);
}

void match_axes(Dataset& data, const Axis& spd, const Axis& radar, Inputs inputs,
                const std::string& owner) {
  const std::string path = data.sources.empty() ? "run" : data.sources.front().path;
  if (inputs != Inputs::radar && !agree(data.spd_axis, spd)) {
    if (!is_near(data.spd_axis, spd)) throw axis_error(path, data.spd_axis, spd, owner);
    resample(data.spd, data.spd_axis, spd, 1);
    if (!data.zones.empty()) resample_zones(data, spd);
    data.spd_axis = spd;
  }
  if (inputs == Inputs::spd) return;
  if (radar.quantity == "binned_power" && data.radar_axis.quantity == "power")
    rebin_radar(data, radar);
  if (!covers(data.radar_axis, radar)) {
    if (!is_near(data.radar_axis, radar)) throw axis_error(path, data.radar_axis, radar, owner);
    resample(data.radar, data.radar_axis, radar, 1);
    data.radar_axis = radar;
  }
  if (data.radar_axis.count == radar.count) return;
  data.radar = first_columns(data.radar, radar.count);
  data.radar_axis.count = radar.count;
}

void match_array(Dataset& data, const Axis& array) {
  if (array.count == 0) return drop_array(data);
  const std::string path = data.sources.empty() ? "run" : data.sources.front().path;
  if (data.array_axis.count == 0)
    throw Error(
        ExitCode::failed,
        printable(path) +
            ": contains no radar antenna samples, which the model needs; for such runs train a "
            "model with --inputs fused-profile");
  if (!covers(data.array_axis, array)) {
    if (!is_near(data.array_axis, array))
      throw axis_error(path, data.array_axis, array, "the model's");
    resample(data.array, data.array_axis, array, lag_values(longest_lag(array)));
    data.array_axis = array;
  }
  if (data.array_axis.count == array.count) return;
  data.array = first_columns(data.array, lag_columns(array));
  data.array_axis.count = array.count;
}

}  // namespace echofuse::recon
