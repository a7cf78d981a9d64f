// SPDX-License-Identifier: MIT
#include "recon/maps/map_files.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "recon/data/files.hpp"
#include "recon/maps/png.hpp"

namespace echofuse::recon {
namespace {

constexpr int picture_zoom = 4;

// Returns the range of the colour scale: from about 1 m in front of the bodies to 1 m behind them,
// or to the farthest background if this is farther.
DepthSpan span_of(const SceneModel& scene) {
  const double body = double{scene.foreground_depth_m};
  const double wall = double{*std::max_element(scene.background.begin(), scene.background.end())};
  const double near = std::max(0.0, std::floor(2 * (body - 1)) / 2);
  const double far = std::ceil(2 * std::max(body + 1, wall)) / 2;
  return {near, std::clamp(far, near + 1, std::max(near + 1, scene.grid.far_m))};
}

// Returns a colour image of the depths in which near pixels are bright.
cv::Mat coloured(const cv::Mat1f& depths, const DepthSpan& span) {
  cv::Mat share, colours;
  depths.convertTo(share, CV_8U, -255 / (span.far - span.near),
                   255 * span.far / (span.far - span.near));
  cv::applyColorMap(share, colours, cv::COLORMAP_VIRIDIS);
  cv::cvtColor(colours, colours, cv::COLOR_BGR2RGB);
  return colours;
}

// Returns the red, green and blue bytes of each value of a map.
Bytes depth_colours(std::span<const float> map, const DepthSpan& span) {
  cv::Mat1f depths(1, static_cast<int>(map.size()));
  std::copy(map.begin(), map.end(), depths.begin());
  const cv::Mat colours = coloured(depths, span);
  return {colours.data, colours.data + 3 * colours.total()};
}

// Returns a PNG of a square map (row-major, metres). Pixels without a return are light grey. Each
// map pixel becomes `zoom` x `zoom` image pixels. If `zoom` is at least 3, the foreground is
// outlined. Throws Error(failed) if encoding fails.
Bytes depth_picture(std::span<const float> map, const DepthSpan& span, int zoom) {
  const cv::Scalar no_return(232, 234, 237), line(60, 65, 72);
  const int side = static_cast<int>(std::lround(std::sqrt(static_cast<double>(map.size()))));
  cv::Mat1f depths(side, side);
  std::copy(map.begin(), map.end(), depths.begin());
  cv::Mat there = depths > 0, colours = coloured(depths, span);
  colours.setTo(no_return, ~there);
  cv::resize(colours, colours, {}, zoom, zoom, cv::INTER_NEAREST);
  if (zoom >= 3) {
    cv::resize(there, there, {}, zoom, zoom, cv::INTER_NEAREST);
    cv::Mat wider;
    cv::dilate(there, wider, cv::getStructuringElement(cv::MORPH_CROSS, {3, 3}));
    colours.setTo(line, wider & ~there);
  }
  const Bytes out =
      encode_png_rgb({colours.data, 3 * colours.total()}, static_cast<std::uint32_t>(colours.cols),
                     static_cast<std::uint32_t>(colours.rows));
  if (out.empty()) throw Error(ExitCode::failed, "cannot encode a PNG picture");
  return out;
}

Bytes millimetre_picture(std::span<const float> map, std::uint32_t size) {
  std::vector<std::uint16_t> mm(map.size());
  for (std::size_t p = 0; p < map.size(); ++p)
    if (map[p] > 0)
      mm[p] = static_cast<std::uint16_t>(std::lround(std::min(map[p] * 1000, 65535.f)));
  return encode_png16(mm, size, size);
}

Bytes point_cloud(std::span<const float> map, const record::MapGrid& grid, const DepthSpan& span) {
  const Axis x = grid.x(), y = grid.y();
  const auto points = std::count_if(map.begin(), map.end(), [](float z) { return z > 0; });
  const std::string head =
      "ply\nformat binary_little_endian 1.0\n"
      "comment camera frame: origin at the detector, x right, y down, z away from it; metres\n"
      "element vertex " +
      std::to_string(points) +
      "\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  Bytes out(head.begin(), head.end());
  const Bytes colours = depth_colours(map, span);
  for (std::size_t p = 0; p < map.size(); ++p) {
    if (!(map[p] > 0)) continue;
    put(out, static_cast<float>(x.at(static_cast<double>(p % x.count)) * double{map[p]}));
    put(out, static_cast<float>(-y.at(static_cast<double>(p / x.count)) * double{map[p]}));
    put(out, map[p]);
    out.insert(out.end(), colours.begin() + static_cast<std::ptrdiff_t>(3 * p),
               colours.begin() + static_cast<std::ptrdiff_t>(3 * p + 3));
  }
  return out;
}

// Returns the pinhole camera model of the maps, in the format of Open3D (intrinsic_matrix,
// column-major) and ROS.
std::string camera_json(const record::MapGrid& grid) {
  const double f = 1 / grid.step(), c = (grid.size - 1) / 2.0;
  const auto n = static_cast<unsigned>(grid.size);
  return format(
      "{\"width\": %u, \"height\": %u, \"fx\": %.9g, \"fy\": %.9g, \"cx\": %g, \"cy\": %g,\n"
      " \"depth_scale\": 1000, \"intrinsic_matrix\": [%.9g, 0, 0, 0, %.9g, 0, %g, %g, 1]}\n",
      n, n, f, f, c, c, f, f, c, c);
}

struct MapFormat {
  const char *name, *what;
};
constexpr std::array<MapFormat, 6> map_formats = {
    {{"colour", "PNG picture"},
     {"mm", "16-bit PNG with depths in mm"},
     {"ply", "point clouds"},
     {"npy", "all maps in one NumPy array"},
     {"foreground",
      "NumPy arrays of the thresholded maps and of the foreground fraction of each pixel"},
     {"uncertainty",
      "16-bit PNG with standard deviations in mm, and also a NumPy array if npy is selected"}}};

}  // namespace

std::vector<std::string> map_format_names() {
  std::vector<std::string> out;
  for (const MapFormat& f : map_formats) out.emplace_back(f.name);
  return out;
}

std::string map_format_help() {
  std::string out;
  for (const MapFormat& f : map_formats)
    out += format("%s%s (%s)", out.empty() ? "" : ", ", f.name, f.what);
  return out;
}

MapFiles::MapFiles(std::string folder, const std::vector<std::string>& formats,
                   const SceneModel& scene)
    : folder_(std::move(folder)), formats_(formats), scene_(scene), span_(span_of(scene)) {
  const std::string camera = camera_json(scene.grid);
  write_file(folder_ + "/camera.json", Bytes(camera.begin(), camera.end()));
  const auto add = [&](const char* name) {
    arrays_.try_emplace(name, folder_ + "/" + name + ".npy",
                        std::vector<std::size_t>(2, scene.grid.size));
  };
  if (wants("npy")) add("maps");
  if (wants("npy") && wants("uncertainty")) add("deviation");
  if (wants("foreground")) add("thresholded"), add("share");
}

bool MapFiles::wants(const char* format) const {
  return std::find(formats_.begin(), formats_.end(), format) != formats_.end();
}

MapFiles::Ready MapFiles::prepare(std::int64_t index, std::span<const float> prediction,
                                  std::span<const float> deviation) const {
  const std::vector<float> map = within_span(prediction, scene_);
  Ready out{index, {}, {}};
  const auto picture = [&](const char* end, Bytes contents) {
    out.pictures.push_back(
        {folder_ + format("/%06lld", static_cast<long long>(index)) + end, std::move(contents)});
  };
  std::vector<float> there;
  if (wants("ply") || wants("colour") || wants("foreground")) there = thresholded_map(map, scene_);
  if (wants("ply")) picture(".ply", point_cloud(there, scene_.grid, span_));
  if (wants("colour")) picture(".png", depth_picture(there, span_, picture_zoom));
  if (wants("mm")) picture("_mm.png", millimetre_picture(map, scene_.grid.size));
  if (wants("uncertainty")) picture("_sd.png", millimetre_picture(deviation, scene_.grid.size));
  const auto with_gaps = [](std::vector<float> depths) {
    for (float& z : depths)
      if (!(z > 0)) z = std::numeric_limits<float>::quiet_NaN();
    return depths;
  };
  for (const auto& [name, file] : arrays_)
    out.rows[name] = name == "maps"          ? with_gaps(map)
                     : name == "thresholded" ? with_gaps(there)
                     : name == "share"       ? foreground_share(map, scene_)
                                             : std::vector(deviation.begin(), deviation.end());
  return out;
}

void MapFiles::write(const Ready& ready) {
  for (const MapFile& file : ready.pictures) write_file(file.path, file.contents);
  for (auto& [name, file] : arrays_) file.append(ready.rows.at(name));
}

void MapFiles::close() {
  for (auto& [name, file] : arrays_) file.close();
}

}  // namespace echofuse::recon
