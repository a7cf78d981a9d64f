// SPDX-License-Identifier: MIT
#include "sim/sensors/scanner.hpp"

#include <map>
#include <mutex>
#include <utility>

#include "sim/scene/room.hpp"

namespace echofuse::sim {

Vec3 Scanner::normal(std::int32_t shape, Vec3 at) const {
  auto number = static_cast<std::size_t>(shape);
  Vec3 out;
  if (number < capsules_.size()) {
    const CapsuleShape& c = capsules_[number].shape;
    const double along =
        c.axis2 > 0 ? std::clamp((dot(at, c.axis) - c.axis_a) / c.axis2, 0.0, 1.0) : 0;
    out = (1 / c.radius) * (at - c.a - along * c.axis);
  } else if (number -= capsules_.size(); number < plates_.size()) {
    out = plates_[number].shape.normal;
  } else {
    out = triangles_[number - plates_.size()].shape.normal;
  }
  return dot(out, at) > 0 ? -1 * out : out;
}

// Returns the image of a static room. The image is rendered once for each sensor and then cached.
// Threading: may be called from any thread.
std::shared_ptr<const Image> Scanner::room_image(const Room& room, double sensor_x_m, const Axis& x,
                                                 const Axis& y, Sampling sampling) {
  static std::mutex mutex;
  using Key = std::pair<const Room*, std::vector<double>>;
  static std::map<Key, std::shared_ptr<const Image>> images;
  constexpr std::size_t max_images = 8;  // maximum number of cached images; a data set needs three
  const Key key{&room,
                {sensor_x_m, static_cast<double>(sampling), x.start, x.step, y.start, y.step,
                 static_cast<double>(x.count), static_cast<double>(y.count)}};
  const std::lock_guard lock(mutex);
  if (const auto known = images.find(key); known != images.end()) return known->second;
  Scene alone;
  alone.plates = room.plates;
  if (images.size() == max_images) images.clear();
  const std::size_t size = std::size_t{x.count} * y.count + spare_rays;
  auto image = std::make_shared<Image>(Image{std::vector<double>(size, INFINITY),
                                             std::vector<double>(size), std::vector<double>(size)});
  Scanner(alone, sensor_x_m, x, y, sampling).scan(Shading::on, [&](const ScanRow& row) {
    const auto put = [&](const double* from, std::vector<double>& to) {
      std::copy(from + row.from, from + row.to, &to[std::size_t{row.iy} * x.count + row.from]);
    };
    put(row.z, image->z);
    put(row.cosine, image->cosine);
    put(row.albedo, image->albedo);
  });
  return images[key] = image;
}

}  // namespace echofuse::sim
