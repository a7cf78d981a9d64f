// SPDX-License-Identifier: MIT
#include "sim/dataset/preview.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "acquire/record/png.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/chart/chart.hpp"
#include "drivers/chart/picture.hpp"
#include "drivers/core/atomic_write.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/log2_codes.hpp"

namespace echofuse::sim {
namespace {

constexpr double least_db = -40;

Bytes png_of(const chart::Raster& r) {
  return record::encode_png_rgb(r.rgb, static_cast<std::uint32_t>(r.columns),
                                static_cast<std::uint32_t>(r.rows));
}

chart::Drawing map_of(const record::RunReader& run, const record::FusedRecord& r) {
  const auto x = run.axis("depth_x"), y = run.axis("depth_y");
  if (!r.has(Sensor::depth) || !x || !y) return chart::no_picture("Depth", "no depth here");
  std::vector<float> metres;
  for (const auto mm : r.depth_mm) metres.push_back(static_cast<float>(mm / 1000.0));
  const chart::Span span = chart::span_of(metres);
  chart::Picture p{"Depth", png_of(chart::depth_raster(metres, x->count, span.near, span.far))};
  p.left = x->at(-0.5), p.right = x->at(x->count - 0.5);
  p.top = y->at(-0.5), p.bottom = y->at(y->count - 0.5);
  p.bar = chart::depth_bar(span.near, span.far);
  return chart::draw(p);
}

// In dB of its strongest value.
chart::Drawing profile_of(const Axis& axis, const record::FusedRecord& r) {
  chart::Panel panel{
      "Radar", {"range (m)"}, {"power (dB of the strongest)"}, {{"", {}, 1, chart::Look::line}}};
  std::vector<double> power;
  for (const float v : r.radar)
    power.push_back(axis.quantity == "log2_q8" ? power_from_code(double{v}, axis.scale)
                                               : double{v});
  const double most = power.empty() ? 0 : *std::max_element(power.begin(), power.end());
  for (std::size_t i = 0; i < power.size(); ++i)
    panel.series[0].points.push_back(
        {axis.at(static_cast<double>(i)),
         std::max(least_db, 10 * std::log10(std::max(power[i] / std::max(most, 1e-300), 1e-300)))});
  return chart::draw(panel);
}

chart::Drawing histogram_of(const Axis& axis, const record::FusedRecord& r) {
  chart::Panel panel{
      "Single-photon detector", {"range (m)"}, {"counts a bin"}, {{"", {}, 0, chart::Look::steps}}};
  for (std::size_t i = 0; i < r.spd.size(); ++i)
    panel.series[0].points.push_back(
        {axis.at(static_cast<double>(i)) / ps_per_m, static_cast<double>(r.spd[i])});
  panel.y.first = 0;
  return chart::draw(panel);
}

// Over range and direction, of the strongest.
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
  if (spd && r.has(Sensor::spd)) drawings.push_back(histogram_of(*spd, r));
  if (radar && r.has(Sensor::radar)) drawings.push_back(profile_of(*radar, r));
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
