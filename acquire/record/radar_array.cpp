// SPDX-License-Identifier: MIT
#include "acquire/record/radar_array.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace echofuse::record {
namespace {

constexpr float full_scale = 32767;

// Where the covariance of antennas m < n begins.
std::size_t place_of(std::size_t m, std::size_t n, std::size_t antennas) {
  return 3 * antennas + 2 * (m * (2 * antennas - m - 1) / 2 + n - m - 1);
}

float power_of(std::span<const float> bin, std::size_t antennas) {
  float sum = 0;
  for (std::size_t m = 0; m < antennas; ++m) sum += bin[2 * antennas + m];
  return sum;
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

ArrayStatistics::ArrayStatistics(std::size_t bins, std::size_t antennas)
    : bins_(bins), antennas_(antennas), sums_(bins * values_of_bin(antennas)) {}

void ArrayStatistics::add(std::span<const std::complex<float>> frame) {
  const std::size_t size = values_of_bin(antennas_);
  // Written out: std::complex asks for infinities at every product.
  const auto* now = reinterpret_cast<const float*>(frame.data());
  const auto* before = reinterpret_cast<const float*>(before_.data());
  for (std::size_t b = 0; b < bins_; ++b, now += 2 * antennas_) {
    float* out = &sums_[b * size];
    for (std::size_t i = 0; i < 2 * antennas_; ++i) *out++ += now[i];
    for (std::size_t m = 0; m < antennas_; ++m)
      *out++ += now[2 * m] * now[2 * m] + now[2 * m + 1] * now[2 * m + 1];
    for (std::size_t m = 0; m < antennas_; ++m) {
      const float re = now[2 * m], im = now[2 * m + 1];
      for (std::size_t n = m + 1; n < antennas_; ++n) {
        *out++ += re * now[2 * n] + im * now[2 * n + 1];
        *out++ += im * now[2 * n] - re * now[2 * n + 1];
      }
    }
    if (before_.empty()) continue;
    for (std::size_t m = 0; m < antennas_; ++m) {
      const float re = before[2 * m], im = before[2 * m + 1];
      out[0] += now[2 * m] * re + now[2 * m + 1] * im;
      out[1] += now[2 * m + 1] * re - now[2 * m] * im;
    }
    before += 2 * antennas_;
  }
  ++frames_;
  pairs_ += !before_.empty();
  before_.assign(frame.begin(), frame.end());
}

std::vector<float> ArrayStatistics::take() {
  const std::size_t size = values_of_bin(antennas_);
  std::vector<float> out;
  if (frames_ > 0) {
    out = std::exchange(sums_, std::vector<float>(sums_.size()));
    const float mean = 1 / static_cast<float>(frames_);
    const float lag = pairs_ > 0 ? 1 / static_cast<float>(pairs_) : 0;
    for (std::size_t i = 0; i < out.size(); ++i) out[i] *= i % size + 2 < size ? mean : lag;
  }
  frames_ = pairs_ = 0;
  before_.clear();
  return out;
}

Bytes pack_array(std::span<const float> array, std::size_t antennas) {
  const std::size_t size = values_of_bin(antennas), bins = array.size() / size;
  Bytes out;
  out.reserve(bins * (sizeof(float) + 2 * size));
  for (std::size_t b = 0; b < bins; ++b) {
    const auto bin = array.subspan(b * size, size);
    const float power = power_of(bin, antennas), amplitude = std::sqrt(power);
    put(out, power);
    for (std::size_t i = 0; i < size; ++i) {
      const float unit = i < 2 * antennas ? amplitude : power;
      const float share = unit > 0 ? std::clamp(bin[i] / unit, -1.0f, 1.0f) : 0;
      put(out, static_cast<std::int16_t>(std::lround(share * full_scale)));
    }
  }
  return out;
}

std::string unpack_array(ByteView bytes, std::size_t bins, std::size_t antennas,
                         std::vector<float>& array) {
  const std::size_t size = values_of_bin(antennas);
  const std::size_t wanted = bins * (sizeof(float) + 2 * size);
  if (bytes.size() != wanted)
    return "array has " + std::to_string(bytes.size()) + " bytes, its axis asks for " +
           std::to_string(wanted);
  array.resize(bins * size);
  ByteReader in(bytes);
  for (std::size_t b = 0; b < bins; ++b) {
    const auto power = in.get<float>();
    if (!std::isfinite(power) || power < 0)
      return "array bin " + std::to_string(b) + " has no finite power";
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
  for (std::size_t n = 1; n <= most_antennas; ++n)
    if (array.scale == static_cast<double>(n)) return n;
  return 0;
}

double array_bytes(const Axis& array) {
  const auto values = static_cast<double>(values_of_bin(antennas_of(array)));
  return array.count * (sizeof(float) + 2 * values);
}

}  // namespace echofuse::record
