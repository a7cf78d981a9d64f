// SPDX-License-Identifier: MIT
// Runs a simulated laboratory on a separate thread, in a temporary folder.
#pragma once
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>

#include "drivers/core/clock.hpp"
#include "sim/lab/lab.hpp"

namespace echofuse::test {

class TemporaryDirectory {
 public:
  TemporaryDirectory() {
    std::string name = (std::filesystem::temp_directory_path() / "echofuse-XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  ~TemporaryDirectory() { std::filesystem::remove_all(path_); }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  std::string operator/(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

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

inline std::string read_text(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

// Returns the part of `text` between `before` and the next quotation mark.
inline std::string quoted_after(const std::string& text, const std::string& before) {
  const std::size_t start = text.find(before) + before.size();
  return text.substr(start, text.find('"', start) - start);
}

}  // namespace echofuse::test
