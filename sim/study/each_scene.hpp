// SPDX-License-Identifier: MIT
// The scenes of a study, on all processors.
#pragma once
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "drivers/core/console.hpp"
#include "drivers/core/exit_code.hpp"

namespace echofuse::sim {

// work(i) of each scene i, in their order. Throws Error(interrupted).
template <class Result, class Work>
std::vector<Result> each_scene(const std::string& title, std::int64_t scenes, bool quiet,
                               const Work& work) {
  std::vector<Result> found(static_cast<std::size_t>(scenes));
  std::atomic<std::size_t> next{0}, done{0};
  const auto run = [&] {
    for (std::size_t i = next++; i < found.size() && !interrupted(); i = next++, ++done)
      found[i] = work(i);
  };
  std::vector<std::future<void>> workers;
  for (unsigned t = 0; t < std::max(1u, std::thread::hardware_concurrency()); ++t)
    workers.push_back(std::async(std::launch::async, run));
  Progress progress(title, found.size(), quiet);
  for (auto& worker : workers)
    while (worker.wait_for(std::chrono::milliseconds(200)) != std::future_status::ready)
      progress.update(done);
  for (auto& worker : workers) worker.get();
  if (interrupted()) throw Error(ExitCode::interrupted, "interrupted; nothing was written");
  return found;
}

}  // namespace echofuse::sim
