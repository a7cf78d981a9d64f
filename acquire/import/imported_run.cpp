// SPDX-License-Identifier: MIT
#include "acquire/import/imported_run.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <utility>

#include "acquire/record/run_reader.hpp"
#include "acquire/record/written_run.hpp"
#include "acquire/run/new_run.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {

UtcTime modified(const std::string& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) return {};
  return std::chrono::seconds(found.st_mtim.tv_sec) +
         std::chrono::nanoseconds(found.st_mtim.tv_nsec);
}

void record_import(Config config, RunOptions options, port::Loop& loop, const NewFile& file) {
  config.policy = {"optional", "optional", "optional"};
  options.out = file.path();
  options.quiet = true;
  record_run(config, options, loop);
  if (interrupted())
    throw Error(ExitCode::interrupted,
                printable(file.place()) + ": interrupted; nothing was written");
}

std::string publish_import(NewFile& file, std::string warnings) {
  const std::string place = printable(file.place());
  record::check_written_run(file.path(), place);
  std::string text, causes;
  bool any = false;
  {
    const record::RunReader run(file.path());
    const record::RunSummary made = run.summary();
    const record::FusedRecord last = run.read(made.last_index);
    text = std::to_string(made.records) + " records";
    for (const Sensor s : all_sensors) {
      const std::string cause = last.sync[s].cause();
      any = any || made.valid[s] > 0;
      if (made.valid[s] > 0)
        text.append(", ").append(name_of(s)).append(" in ").append(std::to_string(made.valid[s]));
      else if (!cause.empty())
        causes.append("; ").append(name_of(s)).append(": ").append(cause);
    }
  }
  if (!any) {
    std::ranges::replace(warnings, '\n', ' ');
    throw Error(ExitCode::failed, place + ": nothing to import: " + printable(text + causes) +
                                      "; no record contains valid data" +
                                      (warnings.empty() ? "" : ";" + warnings));
  }
  file.publish();
  return place + ": " + text;
}

}  // namespace echofuse::acquire
