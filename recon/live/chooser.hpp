// SPDX-License-Identifier: MIT
// Lists the runs of a folder for the start page.
#pragma once
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "drivers/core/clock.hpp"
#include "recon/live/followed_run.hpp"

namespace echofuse::view {

// Threading: one thread.
class Chooser {
 public:
  Chooser(std::string folder, const Clock& clock) : folder_(std::move(folder)), clock_(clock) {}

  // Returns the path of the folder's run with this name (without extension); empty if there is
  // none.
  std::string path_of(const std::string& name) const;
  // Returns a JSON array of the runs, newest first. Each entry has one of:
  //   run     the fields of `echofuse-acquire list --json` except the path, and of the middle
  //           record `map` (cm, chooser_side^2, 0 = no return) or, without a camera, `histogram`
  //           (clicks)
  //   fault   name, and the reason why the file cannot be read
  //   waits   name; the file is not read yet, because a call is limited to half a second: call
  //   again
  std::string runs();

 private:
  struct RunDescription;
  struct CachedRun {
    FileStamp stamp;
    HostTime read{};
    std::shared_ptr<RunDescription> entry;
  };
  std::string folder_;
  const Clock& clock_;
  std::map<std::string, CachedRun> known_;  // by path
};

inline constexpr std::size_t chooser_side = 32;

}  // namespace echofuse::view
