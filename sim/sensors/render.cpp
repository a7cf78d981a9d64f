// SPDX-License-Identifier: MIT
#include "sim/sensors/render.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <optional>
#include <tuple>
#include <utility>

#include "acquire/record/depth_map.hpp"
#include "sim/scene/person.hpp"
#include "sim/scene/room.hpp"
#include "sim/scene/shapes.hpp"
#include "sim/sensors/gaze.hpp"

namespace echofuse::sim {
namespace {

// Points of the axis inside the interval, widened by the half step that a ray may be off and by
// rounding: [first, last).
std::pair<std::uint32_t, std::uint32_t> points_within(const Axis& axis, Interval t) {
  double a = (t.low - axis.start) / axis.step, b = (t.high - axis.start) / axis.step;
  if (a > b) std::swap(a, b);
  const double n = axis.count;
  return {static_cast<std::uint32_t>(std::clamp(std::floor(a - 0.5), 0.0, n)),
          static_cast<std::uint32_t>(std::clamp(std::ceil(b + 0.5) + 1, 0.0, n))};
}

// Steps that spread evenly over (-0.5, 0.5) for any run of k: multiples of the golden ratio.
double golden_offset(std::uint32_t k) {
  const double turns = (k + 0.5) * std::numbers::phi;
  return turns - std::floor(turns) - 0.5;
}

// How far each ray is off its point. Columns are counted from the middle and the two halves are
// mirror images, so that mirrored scenes meet mirrored rays.
struct Offsets {
  std::vector<double> dx_of_row, x_of_column, dy_of_column;
  std::vector<double> side_of_column;  // -1 left of the middle, 1 right of it

  Offsets(const Axis& x, const Axis& y, Sampling sampling)
      : dx_of_row(y.count), x_of_column(x.count), dy_of_column(x.count), side_of_column(x.count) {
    const bool staggered = sampling == Sampling::staggered;
    for (std::uint32_t iy = 0; staggered && iy < y.count; ++iy)
      dx_of_row[iy] = x.step * golden_offset(iy);
    for (std::uint32_t ix = 0; ix < x.count; ++ix) {
      const std::uint32_t mirror = x.count - 1 - ix;
      x_of_column[ix] = x.at(ix);
      side_of_column[ix] = ix < mirror ? -1 : ix > mirror ? 1 : 0;
      if (staggered) dy_of_column[ix] = y.step * golden_offset(std::min(ix, mirror));
    }
  }
};

// A shape and the points of the axes between which it can be met.
template <class Shape>
struct Placed {
  Shape shape;
  std::uint32_t x0 = 0, x1 = 0, y0 = 0, y1 = 0;

  Placed(const Shape& s, const Axis& x, const Axis& y) : shape(s) {
    std::tie(x0, x1) = points_within(x, shape.tangents_x());
    std::tie(y0, y1) = points_within(y, shape.tangents_y());
  }
  bool in_row(std::uint32_t iy) const { return iy >= y0 && iy < y1 && x0 < x1; }
};

constexpr std::int32_t nothing = -1;
// z infinite where there is nothing.
struct Image {
  std::vector<double> z, cosine, albedo;
};

// Rays from..to-1 of a row: (x, y, 1) met something at z, infinite where it did not.
struct Row {
  std::uint32_t iy, from, to;
  const double *x, *y, *z;
  const double *cosine, *albedo;  // for Shading::on
  const std::int32_t* shape;      // nothing: the room
};
enum class Shading : std::uint8_t { off, on };

// Goes through the image row by row, so that one row is all it holds. Shapes are numbered:
// capsules, then plates, then triangles.
class Scanner {
 public:
  Scanner(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y, Sampling sampling)
      : x_(x),
        y_(y),
        offsets_(x, y, sampling),
        ray_x_(x.count),
        ray_y_(x.count),
        met_(x.count),
        z_(x.count),
        cosine_(x.count),
        albedo_(x.count),
        shape_(x.count) {
    const Vec3 sensor{sensor_x_m, 0, 0};
    for (const auto& c : scene.capsules) capsules_.emplace_back(CapsuleShape(c, sensor), x, y);
    for (const auto& p : scene.plates) plates_.emplace_back(PlateShape(p, sensor), x, y);
    for (const auto& t : scene.triangles) triangles_.emplace_back(TriangleShape(t, sensor), x, y);
    std::sort(triangles_.begin(), triangles_.end(),
              [](const auto& a, const auto& b) { return a.y0 < b.y0; });
    if (scene.room) background_ = room_image(sensor_x_m, x, y, sampling);
  }

  // visit(row) for every row in which something can be met.
  template <class Visit>
  void scan(Shading shading, Visit visit) {
    for (std::uint32_t iy = 0; iy < y_.count; ++iy) {
      find_extent(iy);
      if (from_ >= to_) continue;
      aim(iy);
      draw_row(iy);
      if (shading == Shading::on) shade_row();
      if (background_) add_background(iy);
      visit(Row{iy, from_, to_, ray_x_.data(), ray_y_.data(), z_.data(), cosine_.data(),
                albedo_.data(), shape_.data()});
    }
  }

 private:
  static std::shared_ptr<const Image> room_image(double sensor_x_m, const Axis& x, const Axis& y,
                                                 Sampling sampling);

  // use(shape, number) of every shape that reaches into the row.
  template <class Use>
  void for_each_in_row(std::uint32_t iy, Use use) const {
    std::int32_t number = 0;
    for (const auto& capsule : capsules_) {
      if (capsule.in_row(iy)) use(capsule, number);
      ++number;
    }
    for (const auto& plate : plates_) {
      if (plate.in_row(iy)) use(plate, number);
      ++number;
    }
    for (const auto& triangle : triangles_) {
      if (triangle.y0 > iy) break;
      if (triangle.in_row(iy)) use(triangle, number);
      ++number;
    }
  }

  void find_extent(std::uint32_t iy) {
    from_ = background_ ? 0 : x_.count;
    to_ = background_ ? x_.count : 0;
    for_each_in_row(iy, [&](const auto& placed, std::int32_t) {
      from_ = std::min(from_, placed.x0);
      to_ = std::max(to_, placed.x1);
    });
  }

  void aim(std::uint32_t iy) {
    const double dx = offsets_.dx_of_row[iy], y = y_.at(iy);
    for (std::uint32_t ix = from_; ix < to_; ++ix) {
      ray_x_[ix] = offsets_.x_of_column[ix] + dx * offsets_.side_of_column[ix];
      ray_y_[ix] = y + offsets_.dy_of_column[ix];
      z_[ix] = INFINITY;
      shape_[ix] = nothing;
    }
  }

  void draw_row(std::uint32_t iy) {
    for_each_in_row(iy, [&](const auto& placed, std::int32_t number) {
      const std::size_t first = placed.x0, count = placed.x1 - placed.x0;
      placed.shape.meet(&ray_x_[first], &ray_y_[first], met_.data(), count);
      keep_nearer(met_.data(), number, &z_[first], &shape_[first], count);
    });
  }

  void shade_row() {
    for (std::size_t first = from_, last = first; first < to_; first = last) {
      while (last < to_ && shape_[last] == shape_[first]) ++last;
      const auto shade = [&](const auto& shape) {
        shape.cosines(&ray_x_[first], &ray_y_[first], &z_[first], &cosine_[first], last - first);
        std::fill(&albedo_[first], &albedo_[first] + (last - first), shape.albedo);
      };
      auto number = static_cast<std::size_t>(shape_[first]);
      if (shape_[first] == nothing)
        std::fill(&cosine_[first], &cosine_[first] + (last - first), 0.0);
      else if (number < capsules_.size())
        shade(capsules_[number].shape);
      else if (number -= capsules_.size(); number < plates_.size())
        shade(plates_[number].shape);
      else
        shade(triangles_[number - plates_.size()].shape);
    }
  }

  void add_background(std::uint32_t iy) {
    const std::size_t row = std::size_t{iy} * x_.count;
    for (std::uint32_t ix = 0; ix < x_.count; ++ix)
      if (background_->z[row + ix] < z_[ix]) shape_[ix] = nothing;
    put_behind(&background_->z[row], &background_->cosine[row], &background_->albedo[row],
               z_.data(), cosine_.data(), albedo_.data(), x_.count);
  }

  const Axis& x_;
  const Axis& y_;
  Offsets offsets_;
  std::vector<double> ray_x_, ray_y_, met_, z_, cosine_, albedo_;  // of one row
  std::vector<std::int32_t> shape_;
  std::uint32_t from_ = 0, to_ = 0;  // where the row may hold something
  std::vector<Placed<CapsuleShape>> capsules_;
  std::vector<Placed<PlateShape>> plates_;
  std::vector<Placed<TriangleShape>> triangles_;
  std::shared_ptr<const Image> background_;
};

// The room never moves: its image is made once for each sensor. Safe from any thread.
std::shared_ptr<const Image> Scanner::room_image(double sensor_x_m, const Axis& x, const Axis& y,
                                                 Sampling sampling) {
  static std::mutex mutex;
  static std::map<std::vector<double>, std::shared_ptr<const Image>> images;
  constexpr std::size_t most = 8;  // three belong to a data set
  const std::vector<double> key{sensor_x_m,
                                static_cast<double>(sampling),
                                x.start,
                                x.step,
                                y.start,
                                y.step,
                                static_cast<double>(x.count),
                                static_cast<double>(y.count)};
  const std::lock_guard lock(mutex);
  if (const auto known = images.find(key); known != images.end()) return known->second;
  Scene alone;
  alone.plates = room();
  if (images.size() == most) images.clear();
  const std::size_t size = std::size_t{x.count} * y.count;
  auto image = std::make_shared<Image>(Image{std::vector<double>(size, INFINITY),
                                             std::vector<double>(size), std::vector<double>(size)});
  Scanner(alone, sensor_x_m, x, y, sampling).scan(Shading::on, [&](const Row& row) {
    const auto put = [&](const double* from, std::vector<double>& to) {
      std::copy(from + row.from, from + row.to, &to[std::size_t{row.iy} * x.count + row.from]);
    };
    put(row.z, image->z);
    put(row.cosine, image->cosine);
    put(row.albedo, image->albedo);
  });
  return images[key] = image;
}

// To whom shape `number` belongs. People are the capsules, in their order, and hold the plates.
std::int32_t person_of(const Scene& scene, std::int32_t number) {
  const auto capsules = static_cast<std::int32_t>(scene.capsules.size());
  const auto plates = static_cast<std::int32_t>(scene.plates.size());
  if (number == nothing || number >= capsules + plates) return Returns::still;
  if (capsules == 0) return Returns::reflector;
  return number < capsules ? number / capsules_of_person : 0;
}

// Of ray i of the row, which met something at this range.
Returns::Place place_of(const Scene& scene, const Row& row, std::size_t i, double range_m,
                        double sensor_height_m) {
  const double z = row.z[i];
  return {static_cast<float>(row.x[i] * z / range_m), static_cast<float>(row.y[i] * z / range_m),
          static_cast<float>(row.y[i] * z + sensor_height_m), person_of(scene, row.shape[i])};
}

void look(const Scene& scene, const Gaze& gaze, const Axis& x, const Axis& y, Returns& returns) {
  // dOmega = dtx dty / |(tx, ty, 1)|^3
  const double pixel = std::abs(x.step * y.step) / mean_scene_weight;
  const auto capsules = static_cast<std::int32_t>(scene.capsules.size());
  auto& ranges = returns.range_m;
  auto& weights = returns.weight;
  std::vector<double> range(x.count), weight(x.count);
  std::size_t seen = 0;
  returns.place.clear();
  Scanner scanner(scene, gaze.sensor_x_m, x, y, Sampling::staggered);
  scanner.scan(Shading::on, [&](const Row& row) {
    const std::size_t first = row.from, count = row.to - row.from;
    light_back(row.x + first, row.y + first, row.z + first, row.cosine + first, row.albedo + first,
               pixel, range.data(), weight.data(), count);
    gaze.dim({row.x + first, row.y + first, row.cosine + first, row.shape + first}, capsules,
             weight.data(), count);
    ranges.resize(std::max(ranges.size(), seen + count));
    weights.resize(ranges.size());
    for (std::size_t i = 0; i < count; ++i) {
      ranges[seen] = range[i] + gaze.extra_m;
      if (gaze.sway_m > 0 && row.shape[first + i] != nothing) ranges[seen] += gaze.sway(seen);
      weights[seen] = weight[i];
      seen += row.z[first + i] < INFINITY;
    }
    for (std::size_t i = 0; gaze.height_m && i < count; ++i)
      if (row.z[first + i] < INFINITY)
        returns.place.push_back(place_of(scene, row, first + i, range[i], *gaze.height_m));
  });
  ranges.resize(seen);
  weights.resize(seen);
}

// By the floor one way, for all that there is so far.
void reflect_from_floor(const Conditions& c, Returns& returns) {
  const std::size_t seen = returns.range_m.size();
  for (std::size_t k = 0; k < seen; ++k) {
    const Returns::Place p = returns.place[k];
    if (p.person == Returns::reflector) continue;
    const double range = returns.range_m[k] - c.radar_bias_m;
    const double x = p.x * range, y = p.y * range;
    const double image_y = y - 2 * p.height_m;
    const double image_range = std::sqrt(range * range - y * y + image_y * image_y);
    returns.range_m.push_back((range + image_range) / 2 + c.radar_bias_m);
    returns.weight.push_back(c.radar_ground * returns.weight[k]);
    returns.place.push_back({static_cast<float>((p.x + x / image_range) / 2),
                             static_cast<float>((p.y + image_y / image_range) / 2), p.height_m,
                             p.person});
  }
}

Axis x_rays(std::int64_t count, double half_tangent) {
  return record::depth_x_axis(static_cast<std::uint32_t>(count), half_tangent);
}
Axis y_rays(std::int64_t count, double half_tangent) {
  return record::depth_y_axis(static_cast<std::uint32_t>(count), half_tangent);
}
Axis moved(Axis axis, double by) {
  axis.start += by;
  return axis;
}

}  // namespace

std::vector<Hit> cast(const Scene& scene, double sensor_x_m, const Axis& x, const Axis& y,
                      Sampling sampling) {
  std::vector<Hit> hits(std::size_t{x.count} * y.count);
  Scanner(scene, sensor_x_m, x, y, sampling).scan(Shading::on, [&](const Row& row) {
    for (std::size_t ix = row.from; ix < row.to; ++ix) {
      const double z = row.z[ix];
      if (!(z < INFINITY)) continue;
      hits[std::size_t{row.iy} * x.count + ix] = {
          static_cast<float>(z * std::sqrt(row.x[ix] * row.x[ix] + row.y[ix] * row.y[ix] + 1)),
          static_cast<float>(z), static_cast<float>(row.cosine[ix]),
          static_cast<float>(row.albedo[ix])};
    }
  });
  return hits;
}

std::vector<std::uint16_t> render_depth_mm(const Scene& scene, const Axis& x, const Axis& y) {
  std::vector<std::uint16_t> depth(std::size_t{x.count} * y.count);
  Scanner(scene, 0, x, y, Sampling::centres).scan(Shading::off, [&](const Row& row) {
    for (std::size_t ix = row.from; ix < row.to; ++ix)
      if (row.z[ix] <= record::max_depth_m)
        depth[std::size_t{row.iy} * x.count + ix] =
            static_cast<std::uint16_t>(std::lround(1000 * row.z[ix]));
  });
  return depth;
}

void spd_returns(const Scene& scene, const Conditions& c, Returns& out) {
  const std::int64_t rays = rays_of(c);
  const Gaze gaze = spd_gaze(c);
  look(scene, gaze, moved(x_rays(rays, gaze.half_tangent), gaze.middle_x),
       moved(y_rays(rays, gaze.half_tangent), gaze.middle_y), out);
}

void radar_returns(const Scene& scene, const Conditions& c, Returns& out) {
  const bool places = c.radar_antennas > 0 || c.radar_ground > 0;
  Gaze gaze = radar_gaze(c);
  if (places) gaze.height_m = c.camera_height_m;
  const Axis x = x_rays(c.radar_rays, c.radar_half_tangent);
  const Axis y = y_rays(c.radar_rays / 2, c.radar_half_tangent / 2);
  if (radar_sees_apart(scene))
    look(as_radar_sees(scene), gaze, x, y, out);
  else
    look(scene, gaze, x, y, out);
  if (c.radar_ground > 0) reflect_from_floor(c, out);
  if (c.radar_leakage <= 0) return;
  out.range_m.push_back(std::max(0.0, c.radar_bias_m));
  out.weight.push_back(c.radar_leakage);
  if (places) out.place.push_back({0, 0, 0, Returns::leakage});
}

Returns spd_returns(const Scene& scene, const Conditions& c) {
  Returns all;
  spd_returns(scene, c, all);
  return all;
}

Returns radar_returns(const Scene& scene, const Conditions& c) {
  Returns all;
  radar_returns(scene, c, all);
  return all;
}

}  // namespace echofuse::sim
