// SPDX-License-Identifier: MIT
#include "acquire/record/written_run.hpp"

#include "acquire/record/run_reader.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::record {

void check_written_run(const std::string& path, const std::string& place) {
  try {
    RunReader(path).read_all();
  } catch (const Error& e) {
    std::string fault = e.what();
    if (fault.starts_with(path)) fault.erase(0, path.size() + 2);
    throw Error(ExitCode::failed, place + ": the written run cannot be read: " + fault);
  }
}

}  // namespace echofuse::record
