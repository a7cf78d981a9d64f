// SPDX-License-Identifier: MIT
// What happens during a run: to the terminal, and warnings and errors into the run as well.
#pragma once
#include <string>
#include <vector>

#include "acquire/writer.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/core/driver.hpp"

namespace echofuse::acquire {

// Threading: the io thread only.
class RunLog {
 public:
  explicit RunLog(const Clock& clock) : clock_(clock) {}
  void put(Severity severity, const std::string& source, const std::string& text);
  // What was put before goes into the run first. `writer` must outlive this.
  void attach(Writer& writer);

 private:
  const Clock& clock_;
  Writer* writer_ = nullptr;
  std::vector<Writer::Job> waiting_;  // events from before the file existed
};

}  // namespace echofuse::acquire
