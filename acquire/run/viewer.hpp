// SPDX-License-Identifier: MIT
// echofuse-view beside a run.
#pragma once
#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>

namespace echofuse::acquire {

// Prints its address by itself. One that cannot be started is a warning: the run counts more.
class Viewer {
 public:
  // The run file need not be there yet; `planned`: the records that it shall have; `model`: of the
  // maps to be shown, or empty.
  Viewer(const std::string& run, std::optional<std::int64_t> planned, const std::string& model);
  ~Viewer();  // ends it, unless it is left
  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;

  // Leaves the page running; the viewer ends by itself when nobody looks at the run any more.
  void leave() { program_.reset(); }

 private:
  std::optional<pid_t> program_;
};

// Folder that is removed with everything in it. Throws Error(disk) if it cannot be made.
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
