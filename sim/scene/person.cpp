// SPDX-License-Identifier: MIT
// Segment lengths as fractions of the body height: Drillis & Contini 1966, as tabulated by Winter,
// Biomechanics and Motor Control of Human Movement. Radii are chosen to look right.
#include "sim/scene/person.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "sim/scene/draw.hpp"

namespace echofuse::sim {
namespace {

constexpr double hip_height = 0.530, thigh = 0.245, shin = 0.246, ankle_height = 0.039;
constexpr double shoulder_above_hip = 0.275, upper_arm = 0.186, forearm_and_grip = 0.200;
constexpr double shoulder_half_width = 0.115, hip_half_width = 0.055;

double radians(double degrees) { return degrees * std::numbers::pi / 180; }

// A limb's direction: hanging down, swung forward, then spread out to its side (+-1).
Vec3 limb(double side, double swing_deg, double spread_deg) {
  const double swing = radians(swing_deg), spread = radians(spread_deg);
  return {side * std::sin(spread), -std::cos(spread) * std::cos(swing),
          std::cos(spread) * std::sin(swing)};
}

struct Leg {
  Vec3 hip, knee, ankle;
};
Leg random_leg(double side, SceneSampler& sampler) {
  const double swing = sampler.uniform(-15, 25), spread = sampler.uniform(0, 14);
  const double bend = sampler.uniform(0, 30);
  const Vec3 hip{side * hip_half_width, hip_height, 0};
  const Vec3 knee = hip + thigh * limb(side, swing, spread);
  return {hip, knee, knee + shin * limb(side, swing - bend, spread)};
}

// One body. Its own coordinates are in body heights: x to the image's right when it faces -z, y up
// from the floor, z to its front.
class Body {
 public:
  Body(Scene& scene, const Conditions& conditions, const Stand& stand, SceneSampler& sampler)
      : scene_(scene),
        height_m_(conditions.target_scale * sampler.uniform(1.55, 1.90)),
        albedo_(sampler.uniform(0.3, 0.7)),
        ground_{stand.x_m, -conditions.camera_height_m, stand.z_m},
        right_{std::cos(stand.yaw_rad), 0, std::sin(stand.yaw_rad)},
        front_{std::sin(stand.yaw_rad), 0, -std::cos(stand.yaw_rad)} {
    add_legs(sampler);
    add_trunk(sampler);
  }

  Vec3 shoulder(double side) const {
    return along_trunk(shoulder_above_hip, side * shoulder_half_width);
  }
  void add_arm(double side, Vec3 elbow, Vec3 hand) {
    add(shoulder(side), elbow, 0.028);
    add(elbow, hand, 0.024);
  }
  double height_m() const { return height_m_; }
  Vec3 right() const { return right_; }
  Vec3 world(Vec3 p) const {
    return ground_ + height_m_ * (p.x * right_ + p.y * Vec3{0, 1, 0} + p.z * front_);
  }

 private:
  void add(Vec3 a, Vec3 b, double radius) {
    scene_.capsules.push_back({world(a), world(b), height_m_ * radius, albedo_});
  }
  // The lower foot stands on the floor.
  void add_legs(SceneSampler& sampler) {
    const std::array<Leg, 2> legs{random_leg(-1, sampler), random_leg(1, sampler)};
    const double lift = ankle_height - std::min(legs[0].ankle.y, legs[1].ankle.y);
    const Vec3 up{0, lift, 0};
    for (const Leg& leg : legs) {
      const Vec3 heel = leg.ankle + Vec3{0, lift - 0.015, -0.02};
      add(leg.hip + up, leg.knee + up, 0.045);
      add(leg.knee + up, leg.ankle + up, 0.032);
      add(heel, heel + Vec3{0, 0, 0.11}, 0.024);
    }
    hip_ = Vec3{0, hip_height + lift, 0};
  }
  void add_trunk(SceneSampler& sampler) {
    const double bow = radians(sampler.uniform(-5, 12)), tilt = radians(sampler.uniform(-6, 6));
    trunk_ = {std::sin(tilt), std::cos(tilt) * std::cos(bow), std::cos(tilt) * std::sin(bow)};
    add_across(0.01, 0.05, 0.065);   // pelvis
    add_across(0.10, 0.03, 0.068);   // belly
    add_across(0.20, 0.045, 0.074);  // chest
    add_across(shoulder_above_hip, 0.09, 0.042);
    add(along_trunk(0.29, 0), along_trunk(0.34, 0), 0.032);    // neck
    add(along_trunk(0.365, 0), along_trunk(0.415, 0), 0.055);  // head
  }
  Vec3 along_trunk(double above_hip, double sideways) const {
    return hip_ + above_hip * trunk_ + Vec3{sideways, 0, 0};
  }
  void add_across(double above_hip, double half_width, double radius) {
    add(along_trunk(above_hip, -half_width), along_trunk(above_hip, half_width), radius);
  }

  Scene& scene_;
  double height_m_, albedo_;
  Vec3 ground_, right_, front_, hip_, trunk_;
};

}  // namespace

void add_person(Scene& scene, const Conditions& conditions, const Stand& stand,
                SceneSampler& sampler) {
  Body body(scene, conditions, stand, sampler);
  for (const double side : {-1.0, 1.0}) {
    const double swing = sampler.uniform(-25, 80), spread = sampler.uniform(5, 70);
    const double bend = sampler.uniform(0, 90), inward = sampler.uniform(-15, 40);
    const Vec3 elbow = body.shoulder(side) + upper_arm * limb(side, swing, spread);
    body.add_arm(side, elbow, elbow + forearm_and_grip * limb(side, swing + bend, spread - inward));
  }
}

char add_letter_person(Scene& scene, const Conditions& conditions, const Stand& stand,
                       SceneSampler& sampler) {
  const char letter = record::letters[sampler.pick(record::letters.size())];
  const record::LetterSize size =
      record::letter_sizes[sampler.pick(record::letter_sizes.size())].scaled(
          conditions.target_scale);
  Body body(scene, conditions, stand, sampler);
  const Vec3 chest = 0.5 * (body.shoulder(-1) + body.shoulder(1));
  const Vec3 held = chest + Vec3{0, sampler.uniform(-0.12, 0.02), sampler.uniform(0.33, 0.37)};
  for (const double side : {-1.0, 1.0}) {
    const Vec3 hand = held + Vec3{side * size.width_m / 2 / body.height_m(), 0, -0.02};
    const Vec3 middle = 0.5 * (body.shoulder(side) + hand);
    body.add_arm(side, middle + Vec3{side * 0.02, -0.03, 0}, hand);
  }
  scene.plates.push_back(
      {body.world(held), body.right(), {0, 1, 0}, record::letter_strokes(letter, size), 0.8});
  return letter;
}

}  // namespace echofuse::sim
