// SPDX-License-Identifier: MIT
#include "acquire/measurement/radar_array.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace echofuse::record {
namespace {

constexpr float full_scale = 32767;  // because the values are stored as i16

// Returns the position of the covariance of antennas m < n in ArrayBin::values.
std::size_t place_of(std::size_t m, std::size_t n, std::size_t antennas) {
  return 3 * antennas + 2 * (m * (2 * antennas - m - 1) / 2 + n - m - 1);
}

float power_of(std::span<const float> bin, std::size_t antennas) {
  float sum = 0;
  for (std::size_t m = 0; m < antennas; ++m) sum += bin[2 * antennas + m];
  return sum;
}

std::size_t blocks_of(std::size_t bins) { return (bins + lanes - 1) / lanes; }

[[gnu::always_inline]] inline void add_to(float* sum, const Eight& value) {
  Eight all;
  load(all, sum);
  store(sum, all + value);
}

// Adds the samples, powers and covariances of a block of bins to `sums`, in this order.
ECHOFUSE_CLONES void add_products(const float* re, const float* im, std::size_t antennas,
                                  float* sums) {
  Eight a_re, a_im, b_re, b_im;
  float* means = sums;
  float* powers = sums + 2 * antennas * lanes;
  float* pairs = sums + 3 * antennas * lanes;
  for (std::size_t m = 0; m < antennas; ++m) {
    load(a_re, re + m * lanes);
    load(a_im, im + m * lanes);
    add_to(means + 2 * m * lanes, a_re);
    add_to(means + (2 * m + 1) * lanes, a_im);
    add_to(powers + m * lanes, a_re * a_re + a_im * a_im);
    for (std::size_t n = m + 1; n < antennas; ++n, pairs += 2 * lanes) {
      load(b_re, re + n * lanes);
      load(b_im, im + n * lanes);
      add_to(pairs, a_re * b_re + a_im * b_im);
      add_to(pairs + lanes, a_im * b_re - a_re * b_im);
    }
  }
}

// Adds sum_m x_m(t) conj(x_m(t-1)) to `lag`, where x_m(t) is the sample of antenna m in frame t.
ECHOFUSE_CLONES void add_lag(const float* re, const float* im, const float* before_re,
                             const float* before_im, std::size_t antennas, float* lag) {
  Eight a_re, a_im, b_re, b_im, sum_re, sum_im;
  load(sum_re, lag);
  load(sum_im, lag + lanes);
  for (std::size_t m = 0; m < antennas; ++m) {
    load(a_re, re + m * lanes);
    load(a_im, im + m * lanes);
    load(b_re, before_re + m * lanes);
    load(b_im, before_im + m * lanes);
    sum_re += a_re * b_re + a_im * b_im;
    sum_im += a_im * b_re - a_re * b_im;
  }
  store(lag, sum_re);
  store(lag + lanes, sum_im);
}

// Divides values by `unit`, clips the results to +-1 and rounds them to multiples of 1 /
// `full_scale`.
ECHOFUSE_CLONES void to_shares(const float* values, std::size_t count, float unit,
                               std::int16_t* __restrict shares) {
  for (std::size_t i = 0; i < count; ++i) {
    const float share = unit > 0 ? values[i] / unit : 0;
    const float inside = share < -1 ? -1 : share > 1 ? 1 : share;
    const float scaled = inside * full_scale;
    shares[i] = static_cast<std::int16_t>(scaled + (scaled < 0 ? -0.5f : 0.5f));
  }
}

}  // namespace

std::size_t values_of_bin(std::size_t antennas) { return antennas * antennas + 2 * antennas + 2; }

ArrayBin bin_of(std::span<const float> array, std::size_t antennas, std::size_t bin) {
  const std::size_t size = values_of_bin(antennas);
  return {array.subspan(bin * size, size), antennas};
}

float ArrayBin::power() const { return power_of(values, antennas); }

std::complex<float> ArrayBin::covariance(std::size_t m, std::size_t n) const {
  if (m == n) return values[2 * antennas + m];
  return m < n ? pair(place_of(m, n, antennas)) : std::conj(pair(place_of(n, m, antennas)));
}

double beam_power(const ArrayBin& bin, const Antennas& antennas, double u) {
  std::vector<std::complex<double>> weights;
  for (const Antenna& a : antennas)
    weights.push_back(std::polar(1 / a.gain, -a.phase_rad - std::numbers::pi * a.x * u));
  double sum = 0;
  for (std::size_t m = 0; m < antennas.size(); ++m)
    for (std::size_t n = 0; n < antennas.size(); ++n)
      sum +=
          (weights[m] * std::conj(weights[n]) * std::complex<double>(bin.covariance(m, n))).real();
  return sum / static_cast<double>(antennas.size() * antennas.size());
}

ArrayStatistics::ArrayStatistics(std::size_t bins, std::size_t antennas)
    : bins_(bins),
      antennas_(antennas),
      sums_(blocks_of(bins) * lanes * values_of_bin(antennas)),
      before_(blocks_of(bins) * lanes * 2 * antennas) {}

void ArrayStatistics::add_block(std::size_t block, const float* re, const float* im) {
  float* sums = &sums_[block * lanes * values_of_bin(antennas_)];
  float* before = &before_[block * lanes * 2 * antennas_];
  const std::size_t plane = antennas_ * lanes;
  add_products(re, im, antennas_, sums);
  if (has_before_)
    add_lag(re, im, before, before + plane, antennas_,
            sums + lanes * (values_of_bin(antennas_) - 2));
  std::copy_n(re, plane, before);
  std::copy_n(im, plane, before + plane);
}

void ArrayStatistics::count() {
  ++frames_;
  pairs_ += has_before_;
  has_before_ = true;
}

void ArrayStatistics::add_planes(const float* re, const float* im) {
  add_block(0, re, im);
  count();
}

void ArrayStatistics::add(std::span<const std::complex<float>> frame) {
  const std::size_t plane = antennas_ * lanes;
  std::vector<float> planes(2 * plane);
  for (std::size_t block = 0; block < blocks_of(bins_); ++block) {
    for (std::size_t i = 0; i < std::min(lanes, bins_ - block * lanes); ++i)
      for (std::size_t m = 0; m < antennas_; ++m) {
        const auto x = frame[(block * lanes + i) * antennas_ + m];
        planes[m * lanes + i] = x.real();
        planes[plane + m * lanes + i] = x.imag();
      }
    add_block(block, planes.data(), planes.data() + plane);
  }
  count();
}

std::vector<float> ArrayStatistics::take() {
  const std::size_t size = values_of_bin(antennas_);
  std::vector<float> out;
  if (frames_ > 0) {
    out.resize(bins_ * size);
    const float mean = 1 / static_cast<float>(frames_);
    const float lag = pairs_ > 0 ? 1 / static_cast<float>(pairs_) : 0;
    for (std::size_t b = 0; b < bins_; ++b)
      for (std::size_t i = 0; i < size; ++i)
        out[b * size + i] =
            sums_[(b / lanes * size + i) * lanes + b % lanes] * (i + 2 < size ? mean : lag);
    std::fill(sums_.begin(), sums_.end(), 0.f);
  }
  frames_ = pairs_ = 0;
  has_before_ = false;
  return out;
}

Bytes pack_array(std::span<const float> array, std::size_t antennas) {
  const std::size_t size = values_of_bin(antennas), bins = array.size() / size;
  Bytes out;
  out.reserve(bins * (sizeof(float) + 2 * size));
  std::vector<std::int16_t> shares(size);
  for (std::size_t b = 0; b < bins; ++b) {
    const auto bin = array.subspan(b * size, size);
    const float power = power_of(bin, antennas);
    put(out, power);
    to_shares(bin.data(), 2 * antennas, std::sqrt(power), shares.data());
    to_shares(bin.data() + 2 * antennas, size - 2 * antennas, power, shares.data() + 2 * antennas);
    for (const auto share : shares) put(out, share);
  }
  return out;
}

std::string unpack_array(ByteView bytes, std::size_t bins, std::size_t antennas,
                         std::vector<float>& array) {
  const std::size_t size = values_of_bin(antennas);
  const std::size_t expected = bins * (sizeof(float) + 2 * size);
  if (bytes.size() != expected)
    return "has " + std::to_string(bytes.size()) + " bytes, but its axis requires " +
           std::to_string(expected);
  array.resize(bins * size);
  ByteReader in(bytes);
  for (std::size_t b = 0; b < bins; ++b) {
    const auto power = in.get<float>();
    if (!std::isfinite(power) || power < 0)
      return "bin " + std::to_string(b) + ": the power is negative or not finite";
    const float amplitude = std::sqrt(power);
    for (std::size_t i = 0; i < size; ++i)
      array[b * size + i] = static_cast<float>(in.get<std::int16_t>()) / full_scale *
                            (i < 2 * antennas ? amplitude : power);
  }
  return {};
}

Axis array_axis(const Axis& radar, std::size_t antennas) {
  Axis axis = radar;
  axis.name = "array";
  axis.quantity = "covariance";
  axis.scale = static_cast<double>(antennas);
  const double end = std::ceil((array_end_m - radar.start) / radar.step);
  axis.count = static_cast<std::uint32_t>(std::clamp(end, 1.0, static_cast<double>(radar.count)));
  return axis;
}

std::size_t antennas_of(const Axis& array) {
  for (std::size_t n = 1; n <= max_antennas; ++n)
    if (array.scale == static_cast<double>(n)) return n;
  return 0;
}

double array_bytes(const Axis& array) {
  const auto values = static_cast<double>(values_of_bin(antennas_of(array)));
  return array.count * (sizeof(float) + 2 * values);
}

}  // namespace echofuse::record
