// SPDX-License-Identifier: MIT
// Starts echofuse-view for a run.
#pragma once
#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>

namespace echofuse::acquire {

// The viewer prints its address. A failed start is only a warning, so that the run continues.
class Viewer {
 public:
  // The run file may not exist yet; `planned`: number of records; `model`: for live maps, or empty.
  Viewer(const std::string& run, std::optional<std::int64_t> planned, const std::string& model);
  ~Viewer();  // ends the viewer unless it was detached
  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;

  // Keeps the page running; the viewer ends when the run is not viewed any more.
  void leave() { program_.reset(); }

 private:
  std::optional<pid_t> program_;
};

// Temporary folder, removed with its contents. Throws Error(disk) if it cannot be created.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace echofuse::acquire
