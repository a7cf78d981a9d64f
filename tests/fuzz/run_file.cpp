// SPDX-License-Identifier: MIT
// Input: a run file, then optionally its -wal (w) and -journal (j) in the format of files.hpp.
// Reads everything that the commands info and reconstruct read. SQLite is not instrumented. Pages
// of 512 bytes keep the inputs small.
#include <cmath>
#include <limits>

#include "../fixtures/record.hpp"
#include "acquire/record/run_reader.hpp"
#include "files.hpp"
#include "recon/data/dataset.hpp"

using namespace echofuse::record;
using namespace echofuse::test;

namespace {

std::string file_of(ByteView input) {
  static const fuzz::Folder folder;
  fuzz::write_files(folder, fuzz::files_of(input),
                    {{'w', "run.sqlite-wal"}, {'j', "run.sqlite-journal"}});
  const std::size_t end = fuzz::text_of(input).find(fuzz::file_mark);
  folder.write("run.sqlite", input.first(std::min(end, input.size())));
  return folder / "run.sqlite";
}

template <class Body>
void attempt(Body body) {
  fuzz::refused_or_done({ExitCode::failed, ExitCode::disk}, body);
}

void read_records(const RunReader& run) {
  for (const Axis& axis : run.axes())
    for (const Zone& zone : axis.zones) require(zone.plausible(), "zones are plausible");
  std::int64_t last = std::numeric_limits<std::int64_t>::min();
  run.for_each(
      [&](const FusedRecord& r) {
        require(last < r.index || last == std::numeric_limits<std::int64_t>::min(), "in order");
        last = r.index;
        require(r.index <= max_index && r.valid.bits() < 8, "index and mask are valid");
        require(std::ranges::all_of(power(r), [](float v) { return std::isfinite(v); }),
                "radar values are finite");
        return true;
      },
      last, [](std::int64_t, const std::string&) {});
}

// Reads records in the same way as the command `reconstruct`.
void read_parts(const RunReader& run) {
  std::int64_t next = 0;
  for (int parts = 0; parts < 4; ++parts) {
    std::int64_t bad = -1;
    const recon::Dataset data =
        recon::load_part(run, next, 3, recon::sensors_of(recon::Inputs::fused),
                         [&](std::int64_t index, const std::string&) { bad = index; });
    if (data.size() == 0 && bad < 0) return;
    if (data.size() > 0) bad = std::max(bad, data.records.back().index);
    require(bad >= next, "reading advances");
    next = bad + 1;
  }
}

}  // namespace

void fuzz::run(ByteView input) {
  const std::string path = file_of(input);
  attempt([&] {
    const RunReader run(path);
    attempt([&] { run.info(); });
    attempt([&] { run.devices(), run.calibrations(), run.events(), run.counters(); });
    attempt([&] { require(run.count() >= 0, "the number of records is not negative"); });
    attempt([&] { run.summary(); });
    attempt([&] { run.check(); });
    attempt([&] { read_records(run); });
    attempt([&] { read_parts(run); });
  });
}
