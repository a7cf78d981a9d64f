// SPDX-License-Identifier: MIT
// Runs a simulated laboratory on a separate thread, in a temporary folder.
#pragma once
#include <atomic>

#include "../fixtures/folder.hpp"
#include "../fixtures/paths.hpp"
#include "sim/lab/lab.hpp"

namespace echofuse::test {

inline sim::LabOptions options_in(const Folder& dir, const sim::SceneSchedule& schedule = {}) {
  sim::LabOptions options;
  options.dir = dir / "lab";
  options.schedule = schedule;
  return options;
}

class LabThread {
 public:
  explicit LabThread(const sim::LabOptions& options)
      : lab_(loop_, options), thread_([this] { lab_.serve([this] { return stop_.load(); }); }) {}
  ~LabThread() { stop(); }
  LabThread(const LabThread&) = delete;
  LabThread& operator=(const LabThread&) = delete;

  void stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }
  sim::Lab& lab() { return lab_; }

 private:
  port::SystemLoop loop_;
  sim::Lab lab_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace echofuse::test
