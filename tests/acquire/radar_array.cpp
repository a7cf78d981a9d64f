// SPDX-License-Identifier: MIT
#include "acquire/measurement/radar_array.hpp"

#include "testing.hpp"

using namespace echofuse::record;

namespace {

using Samples = std::vector<std::complex<float>>;

std::vector<Samples> some_frames(std::size_t frames, std::size_t samples) {
  std::mt19937 rng(7);
  std::normal_distribution<float> part(0, 1000);
  std::vector<Samples> out(frames, Samples(samples));
  for (auto& frame : out)
    for (auto& x : frame) x = {part(rng), part(rng)};
  return out;
}

std::vector<float> array_of(const std::vector<Samples>& frames, std::size_t antennas) {
  ArrayStatistics sums(frames.front().size() / antennas, antennas);
  for (const auto& frame : frames) sums.add(frame);
  return sums.take();
}

void close_to(std::complex<float> a, std::complex<double> b, double scale) {
  CHECK(std::abs(std::complex<double>(a) - b) < 1e-5 * scale);
}

}  // namespace

TEST_CASE("the mean and the covariance of the antenna array are averages over frames") {
  constexpr std::size_t bins = 3, antennas = 12, count = 9;
  const auto frames = some_frames(count, bins * antennas);
  const auto array = array_of(frames, antennas);
  REQUIRE(array.size() == bins * values_of_bin(antennas));
  for (std::size_t b = 0; b < bins; ++b) {
    const ArrayBin bin = bin_of(array, antennas, b);
    const auto x = [&](std::size_t t, std::size_t m) {
      return std::complex<double>(frames[t][b * antennas + m]);
    };
    std::complex<double> lag = 0;
    for (std::size_t m = 0; m < antennas; ++m) {
      std::complex<double> mean = 0;
      for (std::size_t t = 0; t < count; ++t) mean += x(t, m) / double{count};
      for (std::size_t t = 1; t < count; ++t)
        lag += x(t, m) * std::conj(x(t - 1, m)) / double(count - 1);
      close_to(bin.mean(m), mean, 1e3);
      for (std::size_t n = 0; n < antennas; ++n) {
        std::complex<double> required = 0;
        for (std::size_t t = 0; t < count; ++t)
          required += x(t, m) * std::conj(x(t, n)) / double{count};
        close_to(bin.covariance(m, n), required, 1e6);
      }
    }
    close_to(bin.lag(), lag, 1e7);
  }
}

TEST_CASE("array statistics skip frame pairs across a lost frame, and take() resets the sums") {
  const auto frames = some_frames(3, 8);
  ArrayStatistics sums(1, 8);
  CHECK(sums.take().empty());
  sums.add(frames[0]);
  sums.skip();
  sums.add(frames[1]);
  CHECK(sums.frames() == 2);
  const auto alone = sums.take();
  CHECK(bin_of(alone, 8, 0).lag() == std::complex<float>(0));
  sums.add(frames[0]), sums.add(frames[1]);
  const auto joined = sums.take();
  CHECK(std::abs(bin_of(joined, 8, 0).lag()) > 0);
  CHECK(std::equal(alone.begin(), alone.end() - 2, joined.begin()));
}

TEST_CASE("a packed antenna array is accurate to 4e-5 of the power in its bin") {
  const auto array = array_of(some_frames(4, 3 * 8), 8);
  std::vector<float> back;
  const Bytes packed = pack_array(array, 8);
  CHECK(packed.size() == 3 * (4 + 2 * values_of_bin(8)));
  CHECK(unpack_array(packed, 3, 8, back).empty());
  REQUIRE(back.size() == array.size());
  for (std::size_t b = 0; b < 3; ++b) {
    const ArrayBin was = bin_of(array, 8, b), is = bin_of(back, 8, b);
    for (std::size_t m = 0; m < 8; ++m) {
      CHECK(std::abs(is.mean(m) - was.mean(m)) < 4e-5 * std::sqrt(was.power()));
      for (std::size_t n = 0; n < 8; ++n)
        CHECK(std::abs(is.covariance(m, n) - was.covariance(m, n)) < 4e-5 * was.power());
    }
  }
  CHECK(unpack_array(packed, 2, 8, back) == "has 504 bytes, but its axis requires 336");
  Bytes bad = packed;
  bad[3] = 0xff, bad[2] = 0xc0;
  CHECK(unpack_array(bad, 3, 8, back) == "bin 0: the power is negative or not finite");
}

TEST_CASE("a run without antenna arrays is readable, and an invalid array gives a one-line error") {
  const Folder dir;
  const std::string path = dir / "run";
  RunBuilder wrote = a_small_run(1).antennas(Antennas(8));
  wrote.each([](FusedRecord& r) { antenna_data(r) = array_of(some_frames(5, 4 * 8), 8); })
      .write(path);
  const auto refused = [&](const char* change, const std::vector<Value>& values, const char* why) {
    damaged(path, dir / "bad", change, values);
    check_error(ExitCode::failed, why, [&] {
      const RunReader run(dir / "bad");
      run.antennas();
      run.read(0);
    });
  };
  refused("antenna data of one byte in record ?1", {0}, "record 0: array has 1 bytes");
  refused("axis ?1 has the scale ?2", {"array", 13}, "expected 1 to 12");
  refused("axis ?1 has the scale ?2", {"array", 2.5}, "expected 1 to 12");
  refused("gain of the antennas is ?1", {-1}, "antenna 0 is not valid");
  refused("gain of the antennas is ?1", {1e-30}, "antenna 0 is not valid");
  refused("without antenna ?1", {7}, "7 antennas, but its array axis has 8");
  refused("number of antenna frames is ?1", {-5}, "record 0: array_frames is -5");
  damage(path, "no antennas");
  const RunReader without(path);
  CHECK(without.antennas().empty());
  CHECK(power(without.read(0)) == power(small_record(0)));
}

TEST_CASE("beamforming recovers the direction and the power of a wave despite channel errors") {
  Antennas antennas(8);
  std::vector<Samples> frames(3, Samples(8));
  constexpr double u = 0.3125, power = 9;
  for (std::size_t m = 0; m < 8; ++m) {
    const auto place = static_cast<double>(m);
    antennas[m] = {place, 0, 1 + 0.1 * place, 0.4 * place * place};
    for (std::size_t t = 0; t < 3; ++t)
      frames[t][m] = std::complex<float>(std::polar(
          std::sqrt(power) * antennas[m].gain,
          std::numbers::pi * place * u + antennas[m].phase_rad + static_cast<double>(t)));
  }
  const auto array = array_of(frames, 8);
  const ArrayBin bin = bin_of(array, 8, 0);
  CHECK(beam_power(bin, antennas, u) == Approx(power).epsilon(1e-4));
  // At a distance of 0.1 from the direction sine of the incident wave, the power follows the
  // Dirichlet kernel of an 8-antenna array.
  const double off = 0.1, half = std::numbers::pi * off / 2;
  CHECK(beam_power(bin, antennas, u + off) ==
        Approx(power * std::pow(std::sin(8 * half) / (8 * std::sin(half)), 2)).epsilon(1e-3));
}
