// SPDX-License-Identifier: MIT
#include "recon/data/response_conversion.hpp"

#include <complex>

#include "../catch.hpp"
#include "../fixtures/dataset.hpp"

using namespace echofuse::recon;
using namespace echofuse::test;

namespace {

// Returns the radar response that results from applying the window 1 + a cos(2 pi t) + b cos(4 pi
// t) to the sweep. The range resolution is 0.5 m.
record::RadarResponse windowed(double a, double b) {
  const auto sinc = [](double u) {
    return std::abs(u) < 1e-9 ? 1.0 : std::sin(std::numbers::pi * u) / (std::numbers::pi * u);
  };
  record::RadarResponse out{0.5, {}};
  for (double u = 0; u < 6; u += 0.25)
    out.taps.push_back(std::pow(
        sinc(u) + a / 2 * (sinc(u - 1) + sinc(u + 1)) + b / 2 * (sinc(u - 2) + sinc(u + 2)), 2));
  return out;
}
const record::RadarResponse sinc = windowed(0, 0), hann = windowed(1, 0),
                            blackman = windowed(0.5 / 0.42, 0.08 / 0.42);

// Returns the range profile of two point scatterers measured with a given radar response. The first
// scatterer is at 2.1 m. The second scatterer is at 2.6 m and has half the power.
std::vector<float> profile(const record::RadarResponse& response) {
  std::vector<float> out;
  for (int i = 0; i < 29; ++i)
    out.push_back(
        static_cast<float>(response.power(0.25 * i - 2.1) + 0.5 * response.power(0.25 * i - 2.6)));
  return out;
}

Dataset run_of(const record::RadarResponse& response, const std::vector<float>& row) {
  Dataset data;
  profiles(data).axis = Axis{"radar", "power", "m", 29, 0, 0.25};
  profiles(data) = Matrix(0, row.size());
  profiles(data).add_row(row), profiles(data).add_row(std::vector<float>(row.size()));
  data.records.assign(2, {.valid = SensorSet::from_bits(7)});
  data.sources = {{"run", "", 0, 2, 0, {response}}};
  return data;
}

void convert(Dataset& data, const record::RadarResponse& expected, bool any = false) {
  ModelResponse response;
  response.radar = expected, response.any = any;
  response.convert(data);
}

double greatest_difference(std::span<const float> a, std::span<const float> b) {
  double out = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    out = std::max(out, std::abs(double{a[i]} - double{b[i]}));
  return out;
}

}  // namespace

TEST_CASE("the conversion filter reaches 3 range cells, or as far as either response") {
  record::RadarResponse echo = hann;
  echo.taps[20] = 0.02;  // 5 cells from the peak
  CHECK(response_filter(hann, sinc, 0.25).size() == 2 * 6 + 1);
  CHECK(response_filter(echo, sinc, 0.25).size() == 2 * 10 + 1);
  CHECK(response_filter(hann, echo, 0.25).size() == 2 * 10 + 1);
}

TEST_CASE("a range profile is converted from a narrow to a wide radar response") {
  for (const auto& [own, expected] : {std::pair{sinc, hann}, {sinc, blackman}, {hann, blackman}}) {
    Dataset data = run_of(own, profile(own));
    convert(data, expected);
    CHECK(greatest_difference(profiles(data).row(0), profile(expected)) < 0.02);
    // The profile of a sensor that receives nothing must remain zero.
    CHECK(greatest_difference(profiles(data).row(1), std::vector<float>(29)) == 0);
    CHECK(data.sources[0].response.radar == expected);
    Dataset again = data;
    convert(again, expected);
    CHECK(profiles(again).values == profiles(data).values);
  }
}

TEST_CASE("antenna lags are converted to another radar response like the range profile") {
  // Spatial correlations of the antennas at lags 0, 1 and 2, relative to the power. Lag 0 has one
  // real value, and the other lags have complex values.
  const std::vector<float> factors{1, 0.5f, -0.3f, 0.2f, 0.7f};
  const auto lags = [&](const record::RadarResponse& response) {
    std::vector<float> out;
    for (const float power : profile(response))
      for (const float factor : factors) out.push_back(factor * power);
    return out;
  };
  Dataset data = run_of(sinc, profile(sinc));
  antenna_lags(data).axis = Axis{"array", "lags", "m", 29, 0, 0.25, 2};
  antenna_lags(data) = Matrix(0, lags(sinc).size());
  antenna_lags(data).add_row(lags(sinc)),
      antenna_lags(data).add_row(std::vector<float>(antenna_lags(data).cols));
  convert(data, blackman);
  CHECK(greatest_difference(antenna_lags(data).row(0), lags(blackman)) < 0.02);
}

TEST_CASE("conversion to a narrower radar response limits the amplification of noise") {
  const auto widening = response_filter(sinc, blackman, 0.25),
             narrowing = response_filter(blackman, sinc, 0.25);
  const auto noise = [](const std::vector<double>& weights) {
    double sum = 0;
    for (const double w : weights) sum += w * w;
    return std::sqrt(sum);
  };
  CHECK(noise(widening) < 1);
  CHECK(noise(narrowing) > 1);
  CHECK(noise(narrowing) < 6);
  for (std::size_t i = 0; i < widening.size(); ++i)
    CHECK(widening[i] == Approx(widening[widening.size() - 1 - i]).margin(1e-9));
}

TEST_CASE("a model for many radar responses does not convert runs with much narrower ones") {
  for (const auto& [own, stays] : {std::pair{sinc, true}, {hann, false}, {blackman, true}}) {
    Dataset data = run_of(own, profile(own));
    convert(data, blackman, true);
    CHECK((data.sources[0].response.radar == own) == stays);
    CHECK((greatest_difference(profiles(data).row(0), profile(own)) == 0) == stays);
  }
}

TEST_CASE("runs with binned power or an unknown radar response are not converted") {
  Dataset unstated = run_of({}, profile(sinc)), binned = run_of(sinc, profile(sinc));
  profiles(binned).axis.quantity = "binned_power";
  for (Dataset* data : {&unstated, &binned}) {
    convert(*data, blackman);
    CHECK(greatest_difference(profiles(*data).row(0), profile(sinc)) == 0);
  }
  ModelResponse response(unstated);
  CHECK_FALSE(response.radar.known());
  binned.sources.push_back({"other", "", 2, 0, 0, {hann}});
  binned.sources.push_back({"third", "", 4, 0, 0, {sinc}});
  response = ModelResponse(binned);
  CHECK(response.radar == hann);
}

TEST_CASE("conversion to another radar response sets the relative width and the noise factor") {
  Dataset same = run_of(sinc, profile(sinc)), wider = run_of(hann, profile(hann)),
          narrower = run_of(sinc, profile(sinc));
  convert(same, sinc), convert(wider, sinc), convert(narrower, hann);
  CHECK(times_wider(same, 0) == 1);
  CHECK(same.sources[0].response.noise_factor == 1);
  CHECK(times_wider(wider, 0) == Approx(hann.width_m() / sinc.width_m()));
  CHECK(wider.sources[0].response.noise_factor > 1);
  CHECK(times_wider(narrower, 0) < 1);
  CHECK(narrower.sources[0].response.noise_factor < 1);
}

TEST_CASE("training records that imitate a wider response have the noise of converted records") {
  constexpr std::size_t records = 400;
  constexpr float deviation = 0.01f;
  Rng rng = make_rng(1, 1);
  std::normal_distribution<float> normal;
  const auto noisy = [&](const record::RadarResponse& response) {
    Dataset data = run_of(response, profile(response));
    profiles(data) = Matrix(0, 29), data.records.assign(records, data.records[0]);
    for (std::size_t i = 0; i < records; ++i) {
      std::vector<float> row = profile(response);
      for (float& v : row) v += deviation * normal(rng);
      profiles(data).add_row(row);
    }
    data.sources[0].count = records;
    return data;
  };
  const Rows all = all_rows(records);
  const auto noise_of = [&](const Dataset& data) { return radar_noise(data, all)[0][0]; };
  const Dataset plain = noisy(sinc);
  CHECK(noise_of(plain) == Approx(deviation).epsilon(0.15));
  const WiderRadars wider(plain, all, Inputs::fused);
  REQUIRE(wider.size() >= 2);
  for (std::size_t k = 0; k < 2; ++k) {
    Dataset converted = noisy(wider_responses(sinc)[k]);
    convert(converted, sinc);
    CHECK(times_wider(converted, 0) == Approx(wider.times_wider(k)));
    CHECK(noise_of(converted) > 1.5f * deviation);
    CHECK(noise_of(wider.imitated(k, plain, all, rng)) == Approx(noise_of(converted)).epsilon(0.2));
  }
  CHECK(WiderRadars(plain, all, Inputs::spd).size() == 0);
}

TEST_CASE("a response with unequal flanks is converted to a symmetric one") {
  // Hann window with a cubic phase error of 6 rad at the ends of the sweep.
  const auto power = [](double u) {
    std::complex<double> sum = 0;
    for (int k = 0; k < 400; ++k) {
      const double t = (k + 0.5) / 400 - 0.5;
      sum += (1 + std::cos(2 * std::numbers::pi * t)) *
             std::polar(1., 2 * std::numbers::pi * t * u + 48 * t * t * t);
    }
    return std::norm(sum);
  };
  double peak = 0;
  for (double u = -1; u < 1; u += 1e-3)
    if (power(u) > power(peak)) peak = u;
  const auto relative = [&](double u) { return u == 0 ? 1 : power(peak + u) / power(peak); };
  record::RadarResponse far{0.5, {}}, near{0.5, {}}, even{0.5, {}};
  for (double u = -6; u <= 6; u += 0.25) {
    far.taps.push_back(relative(u)), near.taps.push_back(relative(-u));
    if (u >= 0) even.taps.push_back((relative(u) + relative(-u)) / 2);
  }
  CHECK(near.power(0.3) == far.power(-0.3));
  CHECK(near.width_m() == far.width_m());
  for (const auto& own : {far, near}) {
    const auto error = [&](const record::RadarResponse& stated) {
      Dataset data = run_of(stated, profile(own));
      convert(data, hann);
      return greatest_difference(profiles(data).row(0), profile(hann));
    };
    const double of_both = error(own), of_even = error(even);
    CAPTURE(of_both, of_even);
    CHECK(of_both < 0.01);
    CHECK(of_even > 0.08);
  }
}

TEST_CASE("responses imitated in training are wider than the measured one and sorted by width") {
  for (const auto& own : {sinc, hann, blackman}) {
    double last_m = own.width_m();
    const auto wider = wider_responses(own);
    CHECK(wider.size() >= 2);
    for (const auto& response : wider) {
      CHECK(response.width_m() > last_m);
      CHECK(response.taps[0] == Approx(1));
      last_m = response.width_m();
    }
  }
  CHECK(wider_responses(sinc)[0].width_m() == Approx(hann.width_m()).epsilon(0.01));
  CHECK(wider_responses({}).empty());
}
