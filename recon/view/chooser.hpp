// SPDX-License-Identifier: MIT
// The runs of a folder, of which a browser chooses one.
#pragma once
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "drivers/core/clock.hpp"
#include "recon/view/followed_run.hpp"

namespace echofuse::view {

// Threading: one thread.
class Chooser {
 public:
  Chooser(std::string folder, const Clock& clock) : folder_(std::move(folder)), clock_(clock) {}

  // The run file of this name (without its extension) in the folder itself; empty: there is none.
  std::string path_of(const std::string& name) const;
  // JSON array of the runs, the newest first. An entry has one of:
  //   run     what `echofuse-acquire list --json` tells but its path; of a record in its middle
  //           `map` (cm, chooser_side^2, 0: no return) or, without a camera, `histogram` (clicks)
  //   fault   name, and why the file cannot be read
  //   waits   name; ask again, because a look takes half a second at most
  std::string runs();

 private:
  struct Told;
  struct Known {
    FileStamp stamp;
    HostTime read{};
    std::shared_ptr<Told> told;
  };
  std::string folder_;
  const Clock& clock_;
  std::map<std::string, Known> known_;  // by path
};

inline constexpr std::size_t chooser_side = 32;

}  // namespace echofuse::view
