// SPDX-License-Identifier: MIT
#include "acquire/record/follow.hpp"

#include <chrono>
#include <thread>

namespace echofuse::record {

void follow(const std::string& path, const std::function<bool(const RunReader&)>& take,
            const std::function<bool()>& go_on) {
  constexpr std::chrono::milliseconds pause_between_looks(20);
  while (go_on()) {
    bool open = false;
    {
      const RunReader run(path);
      // The status is read before take(), so that the last records are not missed.
      open = run.info().status == "open";
      if (take(run)) continue;
    }
    if (!open) return;
    std::this_thread::sleep_for(pause_between_looks);
  }
}

}  // namespace echofuse::record
