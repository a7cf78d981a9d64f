// SPDX-License-Identifier: MIT
// Follows a run while it is being recorded, and prints the depth at the centre of each map. Exits
// at the end of the run or on Ctrl-C.
//   g++ -std=c++20 follow_run.cpp $(pkg-config --cflags --libs echofuse) -o follow_run
//   ./follow_run fused.safetensors monday
#include <csignal>
#include <cstdio>
#include <echofuse/predict.hpp>
#include <exception>

namespace {

volatile std::sig_atomic_t stopped = 0;

void print(const echofuse::Record& record, const echofuse::DepthMap& map, std::size_t side) {
  std::printf("record %lld: ", static_cast<long long>(record.index()));
  if (!map.fault.empty()) {
    std::printf("no map: %s\n", map.fault.c_str());
    return;
  }
  const float depth_m = map.depth_m[side / 2 * side + side / 2];
  std::printf("depth at the centre %.2f m", static_cast<double>(depth_m));
  if (map.body) std::printf(", body at x = %.2f m, z = %.2f m", map.body->x_m, map.body->z_m);
  if (!map.out_of_distribution.empty()) std::printf(" (%s)", map.out_of_distribution.c_str());
  std::printf("\n");
}

}  // namespace

int main(int count, char** words) try {
  if (count != 3) return std::fprintf(stderr, "usage: follow_run MODEL RUN\n"), 2;
  std::signal(SIGINT, [](int) { stopped = 1; });
  const echofuse::Model model(words[1]);
  echofuse::follow(
      words[2],
      [&](const echofuse::Run&, const echofuse::Record& record) {
        print(record, echofuse::predict(model, record), model.grid().size);
        return true;
      },
      0, [] { return stopped == 0; },
      [](std::int64_t index, const std::string& fault) {
        std::printf("record %lld: no map: %s\n", static_cast<long long>(index), fault.c_str());
      });
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
