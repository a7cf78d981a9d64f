// SPDX-License-Identifier: MIT
// The scenes of a study, on all processors.
#pragma once
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <future>
#include <numeric>
#include <string>
#include <thread>
#include <vector>

#include "drivers/core/console.hpp"
#include "drivers/core/exit_code.hpp"

namespace echofuse::sim {

// work(i) of each of these scenes i, in their order. Throws Error(interrupted).
template <class Result, class Work>
std::vector<Result> each_of(const std::string& title, const std::vector<std::size_t>& scenes,
                            bool quiet, const Work& work) {
  std::vector<Result> found(scenes.size());
  std::atomic<std::size_t> next{0}, done{0};
  const auto run = [&] {
    for (std::size_t i = next++; i < found.size() && !interrupted(); i = next++, ++done)
      found[i] = work(scenes[i]);
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

// Of all of them.
template <class Result, class Work>
std::vector<Result> each_scene(const std::string& title, std::int64_t scenes, bool quiet,
                               const Work& work) {
  std::vector<std::size_t> all(static_cast<std::size_t>(scenes));
  std::iota(all.begin(), all.end(), std::size_t{0});
  return each_of<Result>(title, all, quiet, work);
}

}  // namespace echofuse::sim
