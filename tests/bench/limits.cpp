// SPDX-License-Identifier: MIT
#include "limits.hpp"

#include <cstdint>
#include <cstdio>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "limits.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace echofuse::bench::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Runs twelve independent chains of multiply-adds, enough to hide their latency. Returns the number
// of multiply-adds.
double multiply_adds(std::size_t rounds, float& sum) {
  const hn::ScalableTag<float> d;
  const auto x = hn::Set(d, 0.999f), y = hn::Set(d, 1e-3f);
  // The chains have different initial values, because the compiler would merge identical chains.
  auto a = hn::Set(d, 1.f), b = hn::Set(d, 2.f), c = hn::Set(d, 3.f), e = hn::Set(d, 4.f);
  auto f = hn::Set(d, 5.f), g = hn::Set(d, 6.f), h = hn::Set(d, 7.f), i = hn::Set(d, 8.f);
  auto j = hn::Set(d, 9.f), k = hn::Set(d, 10.f), l = hn::Set(d, 11.f), m = hn::Set(d, 12.f);
  for (std::size_t n = 0; n < rounds; ++n) {
    a = hn::MulAdd(a, x, y), b = hn::MulAdd(b, x, y), c = hn::MulAdd(c, x, y);
    e = hn::MulAdd(e, x, y), f = hn::MulAdd(f, x, y), g = hn::MulAdd(g, x, y);
    h = hn::MulAdd(h, x, y), i = hn::MulAdd(i, x, y), j = hn::MulAdd(j, x, y);
    k = hn::MulAdd(k, x, y), l = hn::MulAdd(l, x, y), m = hn::MulAdd(m, x, y);
  }
  const auto all = hn::Add(hn::Add(hn::Add(hn::Add(a, b), hn::Add(c, e)), hn::Add(f, g)),
                           hn::Add(hn::Add(hn::Add(h, i), hn::Add(j, k)), hn::Add(l, m)));
  sum += hn::GetLane(all);
  return 12. * static_cast<double>(rounds * hn::Lanes(d));
}

void read(const float* values, std::size_t count, float& sum) {
  const hn::ScalableTag<float> d;
  const std::size_t lanes = hn::Lanes(d);
  auto a = hn::Zero(d), b = a, c = a, e = a;
  for (std::size_t i = 0; i + 4 * lanes <= count; i += 4 * lanes) {
    a = hn::Add(a, hn::LoadU(d, values + i));
    b = hn::Add(b, hn::LoadU(d, values + i + lanes));
    c = hn::Add(c, hn::LoadU(d, values + i + 2 * lanes));
    e = hn::Add(e, hn::LoadU(d, values + i + 3 * lanes));
  }
  sum += hn::GetLane(hn::Add(hn::Add(a, b), hn::Add(c, e)));
}

const char* name() { return hwy::TargetName(HWY_TARGET); }

}  // namespace echofuse::bench::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace echofuse::bench {
namespace {

HWY_EXPORT(multiply_adds);
HWY_EXPORT(read);
HWY_EXPORT(name);

volatile float kept;  // receives the sum, so that the compiler does not remove the loop

}  // namespace

const char* instructions() { return HWY_DYNAMIC_DISPATCH(name)(); }

double multiply_adds_per_s() {
  float sum = 0;
  double done = 0;
  const double s = best_s(20, [&] { done = HWY_DYNAMIC_DISPATCH(multiply_adds)(1'000'000, sum); });
  kept = sum;
  return done / s;
}

double bytes_read_per_s(std::size_t of) {
  const std::vector<float> block(of / sizeof(float), 1.f);
  const std::size_t times = std::max<std::size_t>(1, (std::size_t{1} << 26) / of);
  float sum = 0;
  const double s = best_s(10, [&] {
    for (std::size_t i = 0; i < times; ++i)
      HWY_DYNAMIC_DISPATCH(read)(block.data(), block.size(), sum);
  });
  kept = sum;
  return static_cast<double>(of * times) / s;
}

void print_row(const char* path, const char* unit, double ours, double limit, const char* of_what) {
  std::printf("row\t%s\t%s\t%.6g\t%.6g\t%s\n", path, unit, ours, limit, of_what);
}

void print_peer(const char* path, const char* peer, double value) {
  std::printf("peer\t%s\t%s\t%.6g\n", path, peer, value);
}

}  // namespace echofuse::bench
#endif
