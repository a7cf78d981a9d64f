// SPDX-License-Identifier: MIT
// What happens during a run: to the terminal; warnings, errors and recoveries into the run as well.
// A source has 100 lines in 10 s; of those beyond, the next line after that says how many there
// were: no device can fill the disk, or the journal's queue, with what it does.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "acquire/run/journal.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/core/driver.hpp"

namespace echofuse::acquire {

// Threading: the loop's thread only.
class RunLog {
 public:
  explicit RunLog(const Clock& clock) : clock_(clock) {}
  // A `recovery` goes into the run as well, though it is no warning.
  void put(Severity severity, const std::string& source, const std::string& text,
           bool recovery = false);
  // What was put before goes into the run first. `journal` must outlive this.
  void attach(Journal& journal);

 private:
  struct Source {
    HostTime since{};
    unsigned lines = 0, left_out = 0;
  };
  void write(Severity severity, const std::string& source, const std::string& text, bool kept);

  const Clock& clock_;
  std::map<std::string, Source> sources_;
  Journal* journal_ = nullptr;
  std::vector<Journal::Job> waiting_;  // events from before the file existed
};

}  // namespace echofuse::acquire
