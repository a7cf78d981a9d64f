// SPDX-License-Identifier: MIT
#include "sim/study/scene_rows.hpp"

#include <atomic>
#include <chrono>
#include <future>

#include "drivers/program/console.hpp"
#include "drivers/program/program.hpp"

namespace echofuse::sim {

std::vector<SceneRow> rows_of_scenes(const std::string& title, std::int64_t scenes, bool quiet,
                                     const std::function<SceneRow(std::size_t)>& work) {
  std::vector<SceneRow> found(static_cast<std::size_t>(scenes));
  std::atomic<std::size_t> next{0}, done{0};
  const auto run = [&] {
    for (std::size_t i = next++; i < found.size() && !interrupted(); i = next++, ++done)
      found[i] = work(i);
  };
  std::vector<std::future<void>> workers;
  for (unsigned t = 0; t < usable_cores(); ++t)
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
