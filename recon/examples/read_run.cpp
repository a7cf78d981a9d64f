// SPDX-License-Identifier: MIT
// Prints the label, the number of clicks and the range of the histogram peak for each record of a
// run.
//   g++ -std=c++20 read_run.cpp $(pkg-config --cflags --libs echofuse) -o read_run
//   ./read_run monday
#include <algorithm>
#include <cstdio>
#include <echofuse/run.hpp>
#include <exception>
#include <numeric>

namespace {

void print(const echofuse::Run& run) {
  const auto info = run.info();
  std::printf("%s: %s, %lld records of %g s\n", run.path().c_str(), info.status.c_str(),
              static_cast<long long>(run.count()), info.window_s);
  const auto time = run.axis("spd");
  run.for_each([&](const echofuse::Record& record) {
    std::printf("record %lld %s: ", static_cast<long long>(record.index()), record.label().c_str());
    const auto counts = record.spd();
    if (!time || counts.empty()) {
      std::printf("SPD %s\n", record.spd_quality().verdict.c_str());
      return true;
    }
    const long long clicks = std::accumulate(counts.begin(), counts.end(), 0LL);
    const auto bin = (std::ranges::max_element(counts) - counts.begin()) % time->count;
    const double two_way_ps = time->at(static_cast<double>(bin) + 0.5);
    std::printf("%lld clicks, histogram peak at %.2f m\n", clicks, two_way_ps * 299792458e-12 / 2);
    return true;
  });
}

}  // namespace

int main(int count, char** words) try {
  for (int i = 1; i < count; ++i) print(echofuse::Run(words[i]));
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
