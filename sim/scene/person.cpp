// SPDX-License-Identifier: MIT
// Segment lengths are fractions of the body height from Drillis and Contini (1966), as tabulated by
// Winter, Biomechanics and Motor Control of Human Movement. Radii are estimates.
#include "sim/scene/person.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "sim/scene/draw.hpp"

namespace echofuse::sim {
namespace {

// fractions of the body height (source: see the top of this file)
constexpr double hip_height = 0.530, thigh = 0.245, shin = 0.246, ankle_height = 0.039;
constexpr double shoulder_above_hip = 0.275, upper_arm = 0.186, forearm_and_grip = 0.200;
constexpr double shoulder_half_width = 0.115, hip_half_width = 0.055;

double radians(double degrees) { return degrees * std::numbers::pi / 180; }

// Returns the direction of a limb that hangs down, is swung forward by `swing_deg`, and is then
// spread to its side by `spread_deg`. `side` is -1 or 1.
Vec3 limb(double side, double swing_deg, double spread_deg) {
  const double swing = radians(swing_deg), spread = radians(spread_deg);
  return {side * std::sin(spread), -std::cos(spread) * std::cos(swing),
          std::cos(spread) * std::sin(swing)};
}

// Returns a random factor from 1 - by to 1 + by. If `by` is 0, no random number is drawn.
double varied(double by, Rng& rng) { return by > 0 ? 1 + uniform(rng, -by, by) : 1; }
double varied_log(double by, Rng& rng) { return by > 0 ? std::exp(uniform(rng, -by, by)) : 1; }

// Returns a random joint angle, degrees. `pose_spread` scales the range from low to high about its
// middle.
double pose(double low, double high, const Conditions& c, Rng& rng) {
  const double middle = (low + high) / 2, half = c.pose_spread * (high - low) / 2;
  return uniform(rng, middle - half, middle + half);
}

struct Leg {
  Vec3 hip, knee, ankle;
};
Leg random_leg(double side, double length, const Conditions& c, Rng& rng) {
  const double swing = pose(-15, 25, c, rng), spread = pose(0, 14, c, rng);
  const double bend = pose(0, 30, c, rng);
  const Vec3 hip{side * hip_half_width, hip_height, 0};
  const Vec3 knee = hip + length * thigh * limb(side, swing, spread);
  return {hip, knee, knee + length * shin * limb(side, swing - bend, spread)};
}

// Size factors relative to the base body.
struct Build {
  double girth, shoulders, limbs, legs;
  // Scale factor of the lengths above the hip. The factor is larger for shorter legs, so that the
  // total height does not change.
  double trunk() const { return 1 - (legs - 1) * hip_height / (1 - hip_height); }
};
Build random_build(const Conditions& c, Rng& rng) {
  const double by = c.body_spread;
  return {c.girth * varied(by, rng), c.shoulder_width * varied(by, rng),
          c.limb_width * varied(by, rng), c.leg_length * varied(by / 4, rng)};
}

// Reflectivity of a surface for light and for the radar.
struct Surface {
  double albedo, radar;
};
struct Clothes {
  Surface top, trousers, shoes, skin;
};
Clothes random_clothes(const Conditions& c, double albedo, Rng& rng) {
  const auto part = [&](double radar) {
    const double own = std::min(1.0, albedo * varied_log(c.albedo_contrast, rng));
    constexpr double middle = 0.5;  // middle of the default albedo range
    return Surface{own, radar * (middle + c.radar_follows_albedo * (own - middle))};
  };
  return {part(c.radar_cloth), part(c.radar_cloth), part(c.radar_cloth), part(c.radar_skin)};
}

// Builds one body. Local coordinates are in units of the body height. y points up from the floor
// and z to the front of the body. x points to the right of the image if the body faces the sensors.
class BodyBuilder {
 public:
  BodyBuilder(Scene& scene, const Conditions& conditions, const Stand& stand, Rng& rng)
      : scene_(scene),
        conditions_(conditions),
        height_m_(conditions.target_scale *
                  uniform(rng, conditions.height_min_m, conditions.height_max_m)),
        clothes_(random_clothes(conditions,
                                uniform(rng, conditions.albedo_min, conditions.albedo_max), rng)),
        build_(random_build(conditions, rng)),
        ground_{stand.x_m, -conditions.camera_height_m, stand.z_m},
        right_{std::cos(stand.yaw_rad), 0, std::sin(stand.yaw_rad)},
        front_{std::sin(stand.yaw_rad), 0, -std::cos(stand.yaw_rad)} {
    add_legs(rng);
    add_trunk(rng);
  }

  Vec3 shoulder(double side) const {
    return along_trunk(shoulder_above_hip, side * build_.shoulders * shoulder_half_width);
  }
  void add_arm(double side, Vec3 elbow, Vec3 hand) {
    add(shoulder(side), elbow, 0.028 * build_.limbs, clothes_.top);
    add(elbow, hand, 0.024 * build_.limbs, clothes_.top);
  }
  double height_m() const { return height_m_; }
  Vec3 right() const { return right_; }
  Vec3 front() const { return front_; }
  Vec3 world(Vec3 p) const {
    return ground_ + height_m_ * (p.x * right_ + p.y * Vec3{0, 1, 0} + p.z * front_);
  }

 private:
  void add(Vec3 a, Vec3 b, double radius, const Surface& surface) {
    scene_.capsules.push_back(
        {world(a), world(b), height_m_ * radius, surface.albedo, surface.radar});
  }
  // Adds both legs. The legs are shifted vertically so that the lower foot is on the floor.
  void add_legs(Rng& rng) {
    const std::array<Leg, 2> legs{random_leg(-1, build_.legs, conditions_, rng),
                                  random_leg(1, build_.legs, conditions_, rng)};
    const double lift = ankle_height - std::min(legs[0].ankle.y, legs[1].ankle.y);
    const Vec3 up{0, lift, 0};
    for (const Leg& leg : legs) {
      const Vec3 heel = leg.ankle + Vec3{0, lift - 0.015, -0.02};
      add(leg.hip + up, leg.knee + up, 0.045 * build_.limbs, clothes_.trousers);
      add(leg.knee + up, leg.ankle + up, 0.032 * build_.limbs, clothes_.trousers);
      add(heel, heel + Vec3{0, 0, 0.11}, 0.024, clothes_.shoes);
    }
    hip_ = Vec3{0, hip_height + lift, 0};
  }
  void add_trunk(Rng& rng) {
    const double bow = radians(pose(-5, 12, conditions_, rng));
    const double tilt = radians(pose(-6, 6, conditions_, rng));
    trunk_ = {std::sin(tilt), std::cos(tilt) * std::cos(bow), std::cos(tilt) * std::sin(bow)};
    const double girth = build_.girth;
    add_across(0.01, 0.05 * girth, 0.065 * girth, clothes_.trousers);  // pelvis
    add_across(0.10, 0.03 * girth, 0.068 * girth, clothes_.top);       // belly
    add_across(0.20, 0.045 * girth, 0.074 * girth, clothes_.top);      // chest
    add_across(shoulder_above_hip, 0.09 * build_.shoulders, 0.042, clothes_.top);
    add(along_trunk(0.29, 0), along_trunk(0.34, 0), 0.032, clothes_.skin);    // neck
    add(along_trunk(0.365, 0), along_trunk(0.415, 0), 0.055, clothes_.skin);  // head
  }
  Vec3 along_trunk(double above_hip, double sideways) const {
    return hip_ + build_.trunk() * above_hip * trunk_ + Vec3{sideways, 0, 0};
  }
  void add_across(double above_hip, double half_width, double radius, const Surface& surface) {
    add(along_trunk(above_hip, -half_width), along_trunk(above_hip, half_width), radius, surface);
  }

  Scene& scene_;
  const Conditions& conditions_;
  double height_m_;
  Clothes clothes_;
  Build build_;
  Vec3 ground_, right_, front_, hip_, trunk_;
};

// Returns the plate of a letter, without its position. The plate has its own axes, because it may
// be tilted forward or back.
Plate held_plate(const Conditions& c, const BodyBuilder& body, Rng& rng) {
  const double max_deg = c.letter_tilt_deg;
  const double lean = max_deg > 0 ? radians(uniform(rng, -max_deg, max_deg)) : 0;
  Plate plate;
  plate.u = body.right();
  plate.v = std::cos(lean) * Vec3{0, 1, 0} + std::sin(lean) * body.front();
  plate.albedo = c.letter_albedo;
  plate.radar = c.radar_plate * c.letter_albedo;
  return plate;
}

}  // namespace

void add_person(Scene& scene, const Conditions& conditions, const Stand& stand, Rng& rng) {
  BodyBuilder body(scene, conditions, stand, rng);
  for (const double side : {-1.0, 1.0}) {
    const double swing = pose(-25, 80, conditions, rng);
    const double spread = pose(5, 70, conditions, rng);
    const double bend = pose(0, 90, conditions, rng);
    const double inward = pose(-15, 40, conditions, rng);
    const Vec3 elbow = body.shoulder(side) + upper_arm * limb(side, swing, spread);
    body.add_arm(side, elbow, elbow + forearm_and_grip * limb(side, swing + bend, spread - inward));
  }
}

char add_letter_person(Scene& scene, const Conditions& conditions, const Stand& stand, Rng& rng) {
  const char letter = record::letters[rng() % record::letters.size()];
  const record::LetterSize size = record::letter_sizes[rng() % record::letter_sizes.size()].scaled(
      conditions.target_scale * conditions.letter_scale);
  BodyBuilder body(scene, conditions, stand, rng);
  const Vec3 chest = 0.5 * (body.shoulder(-1) + body.shoulder(1));
  const double lift = uniform(rng, -0.12, 0.02) + conditions.letter_lift_m / body.height_m();
  const Vec3 held = chest + Vec3{0, lift, conditions.letter_reach * uniform(rng, 0.33, 0.37)};
  for (const double side : {-1.0, 1.0}) {
    const Vec3 hand = held + Vec3{side * size.width_m / 2 / body.height_m(), 0, -0.02};
    const Vec3 middle = 0.5 * (body.shoulder(side) + hand);
    body.add_arm(side, middle + Vec3{side * 0.02, -0.03, 0}, hand);
  }
  Plate plate = held_plate(conditions, body, rng);
  plate.centre = body.world(held);
  plate.strokes = record::letter_strokes(letter, size);
  scene.plates.push_back(std::move(plate));
  return letter;
}

}  // namespace echofuse::sim
