// SPDX-License-Identifier: MIT
#include "recon/output/map_files.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "acquire/record/png.hpp"
#include "recon/files/files.hpp"
#include "recon/files/text.hpp"
#include "recon/output/map_pictures.hpp"
#include "recon/output/window.hpp"

namespace echofuse::recon {
namespace {

constexpr int picture_zoom = 4;

Bytes millimetre_picture(std::span<const float> map, std::uint32_t size) {
  std::vector<std::uint16_t> mm(map.size());
  for (std::size_t p = 0; p < map.size(); ++p)
    mm[p] = static_cast<std::uint16_t>(std::lround(std::clamp(map[p] * 1000, 0.f, 65535.f)));
  return record::encode_png16(mm, size, size);
}

Bytes point_cloud(std::span<const float> map, const record::MapGrid& grid) {
  const Axis x = grid.x(), y = grid.y();
  const auto points = std::count_if(map.begin(), map.end(), [](float z) { return z > 0; });
  const std::string head = formatted(
      "ply\nformat binary_little_endian 1.0\nelement vertex %lld\nproperty float x\n"
      "property float y\nproperty float z\nend_header\n",
      static_cast<long long>(points));
  Bytes out(head.begin(), head.end());
  for (std::size_t p = 0; p < map.size(); ++p) {
    if (!(map[p] > 0)) continue;
    put(out, static_cast<float>(x.at(static_cast<double>(p % x.count)) * double{map[p]}));
    put(out, static_cast<float>(y.at(static_cast<double>(p / x.count)) * double{map[p]}));
    put(out, map[p]);
  }
  return out;
}

std::vector<double> values_of(const Axis& axis) {
  std::vector<double> out;
  for (std::uint32_t i = 0; i < axis.count; ++i) out.push_back(axis.at(i));
  return out;
}

struct MapFormat {
  const char *name, *what;
};
constexpr std::array<MapFormat, 7> map_formats = {
    {{"colour", "PNG"},
     {"mm", "PNG of 16-bit millimetres"},
     {"ply", "points"},
     {"mp4", "a film, by ffmpeg"},
     {"gif", "the same"},
     {"npz", "all maps in one file"},
     {"uncertainty", "standard deviations, as mm and npz"}}};

}  // namespace

std::vector<std::string> map_format_names() {
  std::vector<std::string> out;
  for (const MapFormat& f : map_formats) out.emplace_back(f.name);
  return out;
}

std::string map_format_help() {
  std::string out;
  for (const MapFormat& f : map_formats)
    out += formatted("%s%s (%s)", out.empty() ? "" : ", ", f.name, f.what);
  return out;
}

MapFiles::MapFiles(std::string folder, const std::vector<std::string>& formats, const Scene& scene,
                   double zoom_m, bool calibrated, const MapParts* parts)
    : folder_(std::move(folder)),
      formats_(formats),
      scene_(scene),
      span_(span_of(scene)),
      zoom_m_(zoom_m),
      calibrated_(calibrated),
      parts_(parts) {
  for (const char* film : {"mp4", "gif"})
    if (wants(film)) films_.push_back(std::make_unique<Film>(folder_ + "/maps." + film));
  if (!wants("npz")) return;
  const std::size_t size = scene.grid.size;
  arrays_.emplace(folder_ + "/maps.npz");
  arrays_->begin("depth_m", "<f4", {size, size});
  if (!wants("uncertainty")) return;
  deviations_.emplace(folder_ + "/uncertainty.npz");
  deviations_->begin("deviation_m", "<f4", {size, size});
}

bool MapFiles::wants(const char* format) const {
  return std::find(formats_.begin(), formats_.end(), format) != formats_.end();
}

void MapFiles::write(std::int64_t index, std::span<const float> prediction,
                     std::span<const float> deviation) {
  const record::MapGrid& grid = scene_.grid;
  Window window{grid.x(), grid.y()};
  std::vector<float> map = within_span(prediction), deviations(deviation.begin(), deviation.end());
  const auto picture = [&](const char* end, const auto& make) {
    const std::string name = formatted("%06lld%s", static_cast<long long>(index), end);
    if (!parts_ || !parts_->take(name)) write_file(folder_ + "/" + name, make());
  };
  // Only colours, points and films show it.
  std::vector<float> there;
  if (wants("ply") || wants("colour") || !films_.empty()) there = hard_map(map, scene_);
  if (wants("ply")) picture(".ply", [&] { return point_cloud(there, grid); });
  if (zoom_m_ > 0) {
    window = window_about_body(prediction, scene_, zoom_m_);
    map = cut(map, grid, window);
    if (!there.empty()) there = cut(there, grid, window);
    if (!deviations.empty()) deviations = cut(deviations, grid, window);
  }
  if (wants("colour")) picture(".png", [&] { return depth_picture(there, span_, picture_zoom); });
  for (const auto& film : films_)
    film->add(enlarged(chart::depth_raster(there, grid.size, span_.near, span_.far), film_zoom));
  if (wants("mm")) picture("_mm.png", [&] { return millimetre_picture(map, grid.size); });
  if (wants("uncertainty"))
    picture("_sd.png", [&] { return millimetre_picture(deviations, grid.size); });
  if (!arrays_) return;
  arrays_->append(map);
  indices_.push_back(index);
  if (zoom_m_ > 0) {
    const auto x = values_of(window.x), y = values_of(window.y);
    depth_x_.insert(depth_x_.end(), x.begin(), x.end());
    depth_y_.insert(depth_y_.end(), y.begin(), y.end());
  }
  if (deviations_) deviations_->append(deviations);
}

void MapFiles::close() {
  for (const auto& film : films_) film->close();
  if (!arrays_) return;
  arrays_->begin("index", "<i8", {});
  arrays_->append(indices_);
  if (zoom_m_ <= 0) depth_x_ = values_of(scene_.grid.x()), depth_y_ = values_of(scene_.grid.y());
  const auto shape =
      zoom_m_ > 0 ? std::vector<std::size_t>{scene_.grid.size} : std::vector<std::size_t>{};
  arrays_->begin("depth_x", "<f8", shape);
  arrays_->append(depth_x_);
  arrays_->begin("depth_y", "<f8", shape);
  arrays_->append(depth_y_);
  arrays_->begin("calibrated", "|u1", {});
  arrays_->append(std::vector<std::uint8_t>{calibrated_});
  arrays_->close();
  if (deviations_) deviations_->close();
}

}  // namespace echofuse::recon
