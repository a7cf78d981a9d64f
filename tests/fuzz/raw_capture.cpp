// SPDX-License-Identifier: MIT
// Input: the files of a raw capture in the format of files.hpp. They are the times of the run (r)
// and of the devices (t, x, c, d), and the bytes of the devices (capital letters). A CRC of zero in
// the blocks is corrected.
#include <spdlog/spdlog.h>

#include "acquire/import/import.hpp"
#include "acquire/record/run_reader.hpp"
#include "blocks.hpp"
#include "files.hpp"

namespace {

constexpr std::pair<char, const char*> names[] = {
    {'r', "run.times"},        {'t', "tags.times"},  {'T', "tags-001.blocks"}, {'x', "radar.times"},
    {'X', "radar-001.blocks"}, {'d', "depth.times"}, {'D', "depth-001.blocks"}};

constexpr std::string_view lab =
    "[run]\nwindow_s = 0.5\n"
    "[tdc]\naddress = \"bridge:tcp://localhost:1\"\nbins = 8\nbin_width_ps = 1000\n"
    "[radar]\naddress = \"bridge:tcp://localhost:2\"\n"
    "[depth]\naddress = \"bridge:tcp://localhost:3\"\n";

}  // namespace

void fuzz::run(ByteView input) {
  spdlog::set_level(spdlog::level::off);
  static const Folder folder;
  folder.clear();
  const auto files = files_of(input);
  for (const auto& [letter, name] : names) {
    if (!files.contains(letter)) continue;
    Bytes bytes(files.at(letter).begin(), files.at(letter).end());
    if (letter < 'a') put_in_crcs(bytes);
    folder.write(name, bytes);
  }
  folder.write("lab.toml", lab);
  const std::string out = folder / "out.sqlite";
  bool done = false;
  refused_or_done(
      {ExitCode::failed, ExitCode::device},
      [&] {
        acquire::import_kept(acquire::kept_config(folder.path(), {}), folder.path(), out);
        const record::RunReader run(out);
        require(run.check().empty(), "the run of an import has no fault");
        require(run.count() > 0, "the run of an import has records");
        done = true;
      },
      true);
  require(done == std::filesystem::exists(out), "a refused capture gives no run");
}
