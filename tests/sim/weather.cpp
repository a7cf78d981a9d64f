// SPDX-License-Identifier: MIT
#include "sim/scene/weather.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <complex>
#include <numbers>

#include "drivers/core/axis.hpp"
#include "sim/scene/scene.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"
#include "sim/sensors/render.hpp"

namespace {

using namespace echofuse;
using namespace echofuse::sim;

Conditions with_fog(double visibility_m) {
  Conditions c;
  c.fog_visibility_m = visibility_m;
  return c;
}

double sum(const Returns& returns) {
  double out = 0;
  for (const double w : returns.weight) out += w;
  return out;
}

}  // namespace

TEST_CASE("rain takes from 60 GHz what ITU-R P.838-3 tabulates") {
  // Table 5: k_H .8606, alpha_H .7656, k_V .8515, alpha_V .7486.
  CHECK(rain_attenuation_db_km(1, 60) == Approx((0.8606 + 0.8515) / 2).epsilon(1e-3));
  CHECK(rain_attenuation_db_km(50, 60) ==
        Approx((0.8606 * std::pow(50, 0.7656) + 0.8515 * std::pow(50, 0.7486)) / 2).epsilon(1e-3));
}

TEST_CASE("rain takes from light what Marshall and Palmer's drops do, within their forward peak") {
  for (const double rain : {2., 10., 50.}) {
    // Twice the cross sections of N0 exp(-Lambda D), N0 = 8000 / m^3 mm, Lambda = 4.1 R^-.21 / mm.
    const double lambda = 4.1 * std::pow(rain, -0.21);
    const double per_m = 1e-6 * std::numbers::pi * 8000 / std::pow(lambda, 3);
    CHECK(rain_extinction_per_m(rain) / per_m > 0.5);
    CHECK(rain_extinction_per_m(rain) / per_m < 1.1);
  }
}

TEST_CASE("fog's drops hold the water that Shettle and Fenn give them") {
  struct Published {
    double visibility_m, extinction_per_km, water_g_m3;
  };
  // Heavy advection fog and moderate radiation fog: extinction at 550 nm, liquid water.
  for (const Published p : {Published{140, 28.7, 0.37}, Published{500, 8.7, 0.02}})
    CHECK(liquid_water_g_m3(fog_class(p.visibility_m), p.extinction_per_km / 1e3) ==
          Approx(p.water_g_m3).epsilon(0.15));
  // ITU-R P.840: about 0.05 g/m^3 at a visibility of 300 m.
  CHECK(liquid_water_g_m3(fog_class(300), 3.912 / 300) == Approx(0.05).epsilon(0.1));
}

TEST_CASE("fog takes as much of 1550 nm as of 550 nm, as Kim found below 500 m") {
  for (const double visibility_m : {20., 200., 300., 499.}) {
    const double extinction = weather_of(with_fog(visibility_m)).extinction_per_m;
    CHECK(extinction * visibility_m / 3.912 == Approx(1).epsilon(0.12));
  }
  CHECK(extinction_efficiency({3, 0.003}, 1.55, 1.318) == Approx(2).epsilon(0.01));  // large drops
}

TEST_CASE("water takes from 60 GHz what follows from its permittivity") {
  // 11.9 - 19.5i at 20 degrees C (Ellison, J. Phys. Chem. Ref. Data 36, 1, 2007). Drops far smaller
  // than the wavelength absorb 6 pi / lambda Im((e - 1) / (e + 2)) of their volume.
  const std::complex<double> e(11.9, 19.5);
  const double per_m =
      1e-6 * 6 * std::numbers::pi / (299'792'458 / 60e9) * ((e - 1.) / (e + 2.)).imag();
  CHECK(water_attenuation(60, 293.15) == Approx(4342.9 * per_m).epsilon(0.05));
}

TEST_CASE("light fades on its way through fog, and the fog sends some back, with 1/R^2") {
  constexpr double z_m = 4;
  Conditions clear, fog = with_fog(30);
  const Scene scene = make_scene(clear, SceneSpec{SceneKind::reflector}, 1, 0);
  Returns there, through;
  spd_returns(scene, clear, there), spd_returns(scene, fog, through);
  const Weather weather = weather_of(fog);
  const std::size_t patches = there.range_m.size();
  REQUIRE(patches > 10);
  for (std::size_t k = 0; k < patches; ++k)
    REQUIRE(through.weight[k] ==
            Approx(there.weight[k] * std::exp(-2 * weather.extinction_per_m * there.range_m[k]))
                .epsilon(1e-9));
  // Fog alone between two ranges: Omega pi beta * integral of exp(-2 a R) / R^2.
  const double t2 = fog.half_tangent * fog.half_tangent;
  const double solid_angle_sr = 4 * std::asin(t2 / (1 + t2));
  const auto between = [&](double from, double to) {
    double out = 0;
    for (std::size_t k = patches; k < through.weight.size(); ++k)
      if (through.range_m[k] >= from && through.range_m[k] < to) out += through.weight[k];
    return out * mean_scene_weight;
  };
  double closed_form = 0;
  for (double r = 2.0005; r < z_m; r += 0.001)
    closed_form += 0.001 * std::exp(-2 * weather.extinction_per_m * r) / (r * r);
  closed_form *= solid_angle_sr * std::numbers::pi * weather.backscatter_per_m_sr;
  CHECK(between(2, z_m) == Approx(closed_form).epsilon(0.01));
}

TEST_CASE("fog is seen in the detector's field alone, where the light falls") {
  const auto fog_alone = [](double field, double falloff) {
    Conditions c = with_fog(30);
    c.spd_field = field, c.spd_falloff = falloff;
    Returns returns;
    spd_returns({}, c, returns);
    return sum(returns);
  };
  const double all = fog_alone(1, 0);
  CHECK(fog_alone(0.5, 0) / all == Approx(0.30).epsilon(0.05));  // edges are seen at a slant
  CHECK(fog_alone(1, 3) / all < 0.4);
}

TEST_CASE("clear air changes nothing, and rain hardly a radar's echo within a room") {
  const Conditions clear;
  const Scene scene = make_scene(clear, SceneSpec{SceneKind::person}, 1, 0);
  CHECK(weather_of(clear).clear());
  Conditions rain;
  rain.rain_mm_h = 100;
  const double ratio = sum(radar_returns(scene, rain)) / sum(radar_returns(scene, clear));
  CHECK(ratio < 0.99);
  CHECK(ratio > 0.9);
}
