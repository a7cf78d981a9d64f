// SPDX-License-Identifier: MIT
#pragma once
#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>

namespace echofuse::acquire {

// Starts the viewer as a separate program, which prints the address of its page. If the viewer
// fails to start, logs a warning and lets the run continue.
class Viewer {
 public:
  // The run file need not exist yet. `planned` is the planned number of records. `model` is the
  // model for the live depth maps; if it is empty, no depth maps are computed.
  Viewer(const std::string& run, std::optional<std::int64_t> planned, const std::string& model);
  ~Viewer();  // stops the viewer, unless leave() was called
  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;

  // Keeps the viewer running after this object is destroyed. The viewer then exits when the run has
  // ended and its page is closed.
  void leave() { program_.reset(); }

 private:
  std::optional<pid_t> program_;
};

// Temporary folder; the destructor removes it with its contents. The constructor throws Error(disk)
// if the folder cannot be created.
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
