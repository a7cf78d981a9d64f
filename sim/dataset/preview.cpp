// SPDX-License-Identifier: MIT
#include "sim/dataset/preview.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "acquire/record/png.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/chart/chart.hpp"
#include "drivers/chart/picture.hpp"
#include "drivers/chart/style.hpp"
#include "drivers/core/log2_codes.hpp"
#include "drivers/program/atomic_write.hpp"
#include "drivers/program/exit_code.hpp"

namespace echofuse::sim {
namespace {

constexpr double least_db = -40;

Bytes png_of(const chart::Raster& r) {
  return record::encode_png_rgb(r.rgb, static_cast<std::uint32_t>(r.columns),
                                static_cast<std::uint32_t>(r.rows));
}

// The depths are in metres, row after row; the list is empty without a camera.
std::vector<float> depths_of(const record::FusedRecord& r) {
  std::vector<float> metres;
  if (r.has(Sensor::depth))
    for (const auto mm : r.depth_mm) metres.push_back(static_cast<float>(mm / 1000.0));
  return metres;
}

// All scenes share one scale if they lie on it.
chart::Span span_of(const std::vector<float>& metres) {
  chart::Span own = chart::span_of(metres);
  const chart::Span usual;
  std::vector<float> there = metres;
  std::erase_if(there, [](float z) { return !(z > 0); });
  std::sort(there.begin(), there.end());
  if (!there.empty())  // a person before a room makes few of its returns
    own.near = std::min(own.near, std::floor(2 * double{there[there.size() / 500]}) / 2);
  return own.near >= usual.near && own.far <= usual.far ? usual : own;
}

// This is a square about what there is, in pixels, or the whole map if that is most of it.
struct Part {
  std::size_t left = 0, top = 0, size = 0;
};
Part part_of(const std::vector<float>& metres, std::size_t columns) {
  std::size_t first_x = columns, last_x = 0, first_y = columns, last_y = 0;
  for (std::size_t p = 0; p < metres.size(); ++p) {
    if (!(metres[p] > 0)) continue;
    first_x = std::min(first_x, p % columns), last_x = std::max(last_x, p % columns);
    first_y = std::min(first_y, p / columns), last_y = std::max(last_y, p / columns);
  }
  if (first_x > last_x) return {0, 0, columns};
  const std::size_t size =
      std::max(last_x - first_x, last_y - first_y) + 1 + std::max<std::size_t>(columns / 8, 2);
  if (size > columns * 4 / 5) return {0, 0, columns};
  const auto place = [&](std::size_t first, std::size_t last) {
    const std::size_t middle = (first + last + 1) / 2;
    return std::min(middle - std::min(middle, size / 2), columns - size);
  };
  return {place(first_x, last_x), place(first_y, last_y), size};
}

chart::Drawing map_of(const record::RunReader& run, const record::FusedRecord& r) {
  const auto x = run.axis("depth_x"), y = run.axis("depth_y");
  const std::vector<float> metres = depths_of(r);
  if (metres.empty() || !x || !y || x->count != y->count)
    return chart::no_picture("Depth", "no depth here");
  const chart::Span span = span_of(metres);
  const Part part = part_of(metres, x->count);
  std::vector<float> shown;
  for (std::size_t row = part.top; row < part.top + part.size; ++row)
    for (std::size_t column = part.left; column < part.left + part.size; ++column)
      shown.push_back(metres[row * x->count + column]);
  chart::Picture p{"Depth (camera)",
                   png_of(chart::depth_raster(shown, part.size, span.near, span.far))};
  p.marks = {part.size};
  double there = 0;
  for (const float z : shown) {
    p.marks.outlined.push_back(z > 0);
    there += z > 0, p.below += z > 0 && double{z}<span.near, p.above += double{z}> span.far;
  }
  p.below /= std::max(there, 1.0), p.above /= std::max(there, 1.0);
  const auto left = static_cast<double>(part.left), top = static_cast<double>(part.top);
  const auto size = static_cast<double>(part.size);
  p.left = x->at(left - 0.5), p.right = x->at(left + size - 0.5);
  p.top = y->at(top - 0.5), p.bottom = y->at(top + size - 0.5);
  p.bar = chart::depth_bar(span.near, span.far);
  p.note = there < static_cast<double>(shown.size()) ? "Light grey: no return." : "";
  return chart::draw(p);
}

// Both sensors share one axis of range, with the camera's depths on it.
void share_range(chart::Panel& panel, const record::RunReader& run, const record::FusedRecord& r) {
  panel.height = 330;
  panel.x.first = 0;
  if (const auto spd = run.axis("spd")) panel.x.last = std::ceil(spd->at(spd->count) / ps_per_m);
  std::vector<float> there = depths_of(r);
  std::erase_if(there, [](float z) { return !(z > 0); });
  if (there.empty()) return;
  std::sort(there.begin(), there.end());
  const auto at = [&](double share) {
    return double{there[static_cast<std::size_t>(share * static_cast<double>(there.size() - 1))]};
  };
  if (at(0.98) - at(0.02) < 1.5)
    panel.rules = {{at(0.5), "camera", true}};
  else
    panel.rules = {{at(0.02), "nearest", true}, {at(0.98), "wall", true}};
}

// The powers are in dB of the strongest value.
chart::Drawing profile_of(const record::RunReader& run, const Axis& axis,
                          const record::FusedRecord& r) {
  chart::Panel panel{"Radar: power by range",
                     {"range (m)"},
                     {"power (dB, 0: the strongest bin)", false, least_db, 2},
                     {{"", {}, chart::of_radar, chart::Look::line}}};
  share_range(panel, run, r);
  std::vector<double> power;
  for (const float v : r.radar)
    power.push_back(axis.quantity == "log2_q8" ? power_from_code(double{v}, axis.scale)
                                               : double{v});
  const double most = power.empty() ? 0 : *std::max_element(power.begin(), power.end());
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double db = 10 * std::log10(std::max(power[i] / std::max(most, 1e-300), 1e-300));
    panel.series[0].points.push_back(
        {axis.at(static_cast<double>(i)), db < least_db ? chart::nan : db});
  }
  return chart::draw(panel);
}

chart::Drawing histogram_of(const record::RunReader& run, const Axis& axis,
                            const record::FusedRecord& r) {
  chart::Panel panel{"SPD: clicks by range",
                     {"range (m)"},
                     {"clicks a bin"},
                     {{"", {}, chart::of_spd, chart::Look::steps}}};
  share_range(panel, run, r);
  for (std::size_t i = 0; i < r.spd.size(); ++i)
    panel.series[0].points.push_back(
        {axis.at(static_cast<double>(i)) / ps_per_m, static_cast<double>(r.spd[i])});
  panel.y.first = 0;
  return chart::draw(panel);
}

// The power is drawn over range and direction, in dB of the strongest.
chart::Drawing beams_of(const Axis& range, const record::Antennas& antennas,
                        const record::FusedRecord& r) {
  std::vector<double> powers;
  for (std::size_t b = range.count; b-- > 0;)
    for (std::size_t k = 0; k < record::beams; ++k)
      powers.push_back(record::beam_power(record::bin_of(r.array, antennas.size(), b), antennas,
                                          record::beam_cosine(k)));
  const double most = *std::max_element(powers.begin(), powers.end());
  constexpr double floor_db = -30;
  std::vector<float> db;
  for (const double p : powers)
    db.push_back(static_cast<float>(
        p > 0 && most > 0 ? std::max(floor_db, 10 * std::log10(p / most)) : floor_db));
  chart::Picture p{"Radar's antennas",
                   png_of(chart::raster(db, record::beams, chart::ColourMap::level, floor_db, 0))};
  p.bottom = range.at(-0.5), p.top = range.at(range.count - 0.5);
  p.degrees = false, p.x_title = "sine of the azimuth", p.y_title = "range (m)", p.ratio = 1;
  p.bar = {chart::ColourMap::level, floor_db, 0, "dB"};
  return chart::draw(p);
}

}  // namespace

void draw_record(const std::string& run_path, std::int64_t index, const std::string& svg) {
  if (!svg.ends_with(".svg"))
    throw Error(ExitCode::usage, svg + ": expected a name that ends in .svg");
  const record::RunReader run(run_path);
  const record::FusedRecord r = run.read(index);
  const auto spd = run.axis("spd"), radar = run.axis("radar"), array = run.axis("array");
  const auto antennas = run.antennas();
  std::vector<chart::Drawing> drawings{map_of(run, r)};
  if (spd && r.has(Sensor::spd)) drawings.push_back(histogram_of(run, *spd, r));
  if (radar && r.has(Sensor::radar)) drawings.push_back(profile_of(run, *radar, r));
  if (array && !antennas.empty() && !r.array.empty())
    drawings.push_back(beams_of(*array, antennas, r));
  const auto path = std::filesystem::absolute(svg);
  if (!std::filesystem::is_directory(path.parent_path()))
    throw Error(ExitCode::disk, svg + ": no such folder");
  write_atomically(svg, chart::stand_alone("Record " + std::to_string(index) +
                                               (r.label.empty() ? "" : ": " + r.label),
                                           drawings, drawings.size()));
}

}  // namespace echofuse::sim
