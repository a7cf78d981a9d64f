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

// Threading: must be used from one thread only.
class Chooser {
 public:
  Chooser(std::string folder, const Clock& clock) : folder_(std::move(folder)), clock_(clock) {}

  // Returns the path of the run with this name (without extension); empty if the folder does not
  // contain it.
  std::string path_of(const std::string& name) const;
  // Returns a JSON array with one object per run, newest first. There are three kinds of objects:
  //   readable run    all fields of `echofuse-acquire list --json` except the path, and one field
  //                   taken from the middle record: `map` (cm, chooser_side x chooser_side pixels,
  //                   0: no return) or, if that record has no depth map, `histogram` (clicks)
  //   damaged run     `name`, and `fault`, which contains the reason
  //   unread run      `name`, and `waits`: true. Each call reads files for at most half a second;
  //                   call again to read the rest.
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
  std::map<std::string, CachedRun> known_;  // cached entries by path
};

inline constexpr std::size_t chooser_side = 32;

}  // namespace echofuse::view
