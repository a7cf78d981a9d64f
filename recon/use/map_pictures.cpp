// SPDX-License-Identifier: MIT
#include "recon/use/map_pictures.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "drivers/program/exit_code.hpp"
#include "recon/use/png.hpp"

namespace echofuse::recon {

DepthSpan span_of(const Scene& scene) {
  const double body = double{scene.foreground_depth_m};
  const double wall = double{*std::max_element(scene.background.begin(), scene.background.end())};
  const double near = std::max(0.0, std::floor(2 * (body - 1)) / 2);
  const double far = std::ceil(2 * std::max(body + 1, wall)) / 2;
  return {near, std::clamp(far, near + 1, std::max(near + 1, scene.grid.far_m))};
}

namespace {

cv::Mat coloured(const cv::Mat1f& depths, const DepthSpan& span) {
  cv::Mat share, colours;
  depths.convertTo(share, CV_8U, -255 / (span.far - span.near),
                   255 * span.far / (span.far - span.near));
  cv::applyColorMap(share, colours, cv::COLORMAP_VIRIDIS);
  cv::cvtColor(colours, colours, cv::COLOR_BGR2RGB);
  return colours;
}

}  // namespace

Bytes depth_colours(std::span<const float> map, const DepthSpan& span) {
  cv::Mat1f depths(1, static_cast<int>(map.size()));
  std::copy(map.begin(), map.end(), depths.begin());
  const cv::Mat colours = coloured(depths, span);
  return {colours.data, colours.data + 3 * colours.total()};
}

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

}  // namespace echofuse::recon
