// SPDX-License-Identifier: MIT
#include "sim/scene/weather.hpp"

#include <array>
#include <cmath>
#include <numbers>

namespace echofuse::sim {
namespace {

constexpr double koschmieder = 3.912;  // -ln 0.02
constexpr double laser_um = 1.55, visible_um = 0.55;
constexpr double water_at_laser = 1.318, water_visible = 1.333;  // refractive indices
constexpr double radar_ghz = 60, air_k = 288;
constexpr double lidar_ratio_drops_sr = 18.8, lidar_ratio_smoke_sr = 60;
constexpr double smoke_exponent = 1.3;        // Angstrom's exponent of aged smoke
constexpr double db_per_neper = 4.342944819;  // decibels of power

// Anomalous diffraction holds: drops are large, and refract little.
double efficiency(double radius_um, double wavelength_um, double refractive_index) {
  const double rho = 4 * std::numbers::pi * radius_um / wavelength_um * (refractive_index - 1);
  if (rho < 1e-3) return rho * rho / 2;
  return 2 - 4 / rho * std::sin(rho) + 4 / (rho * rho) * (1 - std::cos(rho));
}

// Integral over all radii of r^power exp(-b r) weighed by f, in steps of a 400th of the mean.
template <class F>
double integral(const DropClass& drops, double power, const F& f) {
  const double mean = (drops.alpha + power + 1) / drops.b_per_um, step = mean / 400;
  double sum = 0;
  for (int i = 1; i < 4000; ++i) {
    const double r = i * step;
    sum += std::pow(r / mean, drops.alpha + power) * std::exp(-drops.b_per_um * r) * f(r) * step;
  }
  return sum * std::pow(mean, drops.alpha + power);
}

double one(double) { return 1; }

struct Terms {
  std::array<double, 5> a, b, c;
  double slope, offset;
  double at(double log_f) const {
    double out = slope * log_f + offset;
    for (std::size_t j = 0; j < a.size(); ++j)
      if (c[j] != 0) out += a[j] * std::exp(-std::pow((log_f - b[j]) / c[j], 2));
    return out;
  }
};

// The terms are those of ITU-R P.838-3, tables 1 to 4.
constexpr Terms k_h{{-5.33980, -0.35351, -0.23789, -0.94158, 0},
                    {-0.10008, 1.26970, 0.86036, 0.64552, 0},
                    {1.13098, 0.45400, 0.15354, 0.16817, 0},
                    -0.18961,
                    0.71147};
constexpr Terms k_v{{-3.80595, -3.44965, -0.39902, 0.50167, 0},
                    {0.56934, -0.22911, 0.73042, 1.07319, 0},
                    {0.81061, 0.51059, 0.11899, 0.27195, 0},
                    -0.16398,
                    0.63297};
constexpr Terms alpha_h{{-0.14318, 0.29591, 0.32177, -5.37610, 16.1721},
                        {1.82442, 0.77564, 0.63773, -0.96230, -3.29980},
                        {-0.55187, 0.19822, 0.13164, 1.47828, 3.43990},
                        0.67849,
                        -1.95537};
constexpr Terms alpha_v{{-0.07771, 0.56727, -0.20238, -48.2991, 48.5833},
                        {2.33840, 0.95545, 1.14520, 0.791669, 0.791459},
                        {-0.76284, 0.54039, 0.26809, 0.116226, 0.116479},
                        -0.053739,
                        0.83433};

}  // namespace

DropClass fog_class(double visibility_m) {
  if (visibility_m < 180) return {3, 0.3};    // heavy advection fog
  if (visibility_m < 235) return {3, 0.375};  // moderate advection fog
  if (visibility_m < 350) return {6, 1.5};    // heavy radiation fog
  return {6, 3};                              // moderate radiation fog
}

double extinction_efficiency(const DropClass& drops, double wavelength_um,
                             double refractive_index) {
  return integral(drops, 2,
                  [&](double r) { return efficiency(r, wavelength_um, refractive_index); }) /
         integral(drops, 2, one);
}

double liquid_water_g_m3(const DropClass& drops, double extinction_550_per_m) {
  const double area =
      extinction_550_per_m / extinction_efficiency(drops, visible_um, water_visible);
  const double effective_radius_m = 1e-6 * integral(drops, 3, one) / integral(drops, 2, one);
  return 1e6 * 4.0 / 3 * effective_radius_m * area;
}

double rain_extinction_per_m(double rain_mm_h) {
  return 1.076e-3 * std::pow(rain_mm_h, 0.67) / db_per_neper;
}

double rain_attenuation_db_km(double rain_mm_h, double frequency_ghz) {
  const double f = std::log10(frequency_ghz);
  return (std::pow(10, k_h.at(f)) * std::pow(rain_mm_h, alpha_h.at(f)) +
          std::pow(10, k_v.at(f)) * std::pow(rain_mm_h, alpha_v.at(f))) /
         2;
}

double water_attenuation(double f, double temperature_k) {
  const double theta = 300 / temperature_k - 1;
  const double e0 = 77.66 + 103.3 * theta, e1 = 0.0671 * e0, e2 = 3.52;
  const double fp = 20.20 - 146 * theta + 316 * theta * theta, fs = 39.8 * fp;
  const double p = 1 + f * f / (fp * fp), s = 1 + f * f / (fs * fs);
  const double real = (e0 - e1) / p + (e1 - e2) / s + e2;
  const double imaginary = f * (e0 - e1) / (fp * p) + f * (e1 - e2) / (fs * s);
  const double eta = (2 + real) / imaginary;
  return 0.819 * f / (imaginary * (1 + eta * eta));
}

namespace {

Weather new_weather(const Conditions& c) {
  Weather out;
  const auto add = [&](double extinction_per_m, double lidar_ratio_sr) {
    out.extinction_per_m += extinction_per_m;
    out.backscatter_per_m_sr += extinction_per_m / lidar_ratio_sr;
  };
  if (c.fog_visibility_m > 0) {
    const DropClass drops = fog_class(c.fog_visibility_m);
    const double visible = koschmieder / c.fog_visibility_m;
    add(visible * extinction_efficiency(drops, laser_um, water_at_laser) /
            extinction_efficiency(drops, visible_um, water_visible),
        lidar_ratio_drops_sr);
    out.radar_attenuation_db_m +=
        1e-3 * water_attenuation(radar_ghz, air_k) * liquid_water_g_m3(drops, visible);
  }
  if (c.smoke_visibility_m > 0)
    add(koschmieder / c.smoke_visibility_m * std::pow(visible_um / laser_um, smoke_exponent),
        lidar_ratio_smoke_sr);
  if (c.rain_mm_h > 0) {
    add(rain_extinction_per_m(c.rain_mm_h), lidar_ratio_drops_sr);
    out.radar_attenuation_db_m += 1e-3 * rain_attenuation_db_km(c.rain_mm_h, radar_ghz);
  }
  return out;
}

}  // namespace

// A data set asks for it with every record, and the answer is always the same.
Weather weather_of(const Conditions& c) {
  if (c.fog_visibility_m == 0 && c.smoke_visibility_m == 0 && c.rain_mm_h == 0) return {};
  thread_local std::array<double, 3> asked{};
  thread_local Weather found;
  const std::array<double, 3> wanted{c.fog_visibility_m, c.smoke_visibility_m, c.rain_mm_h};
  if (asked != wanted) found = new_weather(c), asked = wanted;
  return found;
}

}  // namespace echofuse::sim
