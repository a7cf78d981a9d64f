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
  // A JSON array of the runs, the newest first: what `echofuse-acquire list --json` tells of each
  // but its path, and of a record of its middle `map` (cm, chooser_side^2, 0 without a return) or,
  // without a camera, `histogram` (clicks, the highest of neighbours). Or name and `fault`, why
  // it cannot be read; or name and `waits`, as a look takes half a second at most: ask again.
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
