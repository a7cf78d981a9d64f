// SPDX-License-Identifier: MIT
// Input: a folder of arrays in the format of files.hpp. The folder has run.toml (t) and .npy files.
// A lower-case letter starts the bytes of a .npy file, and an upper-case letter starts a recipe for
// a .npy file. run.toml may refer to the run base.sqlite.
#include "acquire/import/import.hpp"
#include "acquire/record/run_reader.hpp"
#include "files.hpp"

namespace {

constexpr std::pair<char, const char*> names[] = {{'s', "spd.npy"},   {'r', "radar.npy"},
                                                  {'a', "array.npy"}, {'d', "depth.npy"},
                                                  {'i', "index.npy"}, {'v', "valid.npy"}};

constexpr std::uint8_t counts[] = {4, 2, 3, 8, 1, 0, 0, 0}, power[] = {0, 2, 3, 4, 0, 0, 128, 63};

// Returns the contents of a run file with three records. run.toml can refer to the file by the name
// base.sqlite.
const Bytes& base() {
  static const Bytes run = [] {
    const fuzz::Folder folder;
    folder.write("spd.npy", fuzz::npy_of(counts));
    folder.write("radar.npy", fuzz::npy_of(power));
    folder.write("run.toml", "");
    acquire::import_arrays(folder.path(), folder / "base.sqlite", UtcTime{});
    std::ifstream in(folder / "base.sqlite", std::ios::binary);
    return Bytes{std::istreambuf_iterator<char>(in), {}};
  }();
  return run;
}

void check_run(const std::string& path) {
  const record::RunReader run(path);
  require(run.check().empty(), "the run of an import has no fault");
  require(run.count() > 0, "the run of an import has records");
}

}  // namespace

void fuzz::run(ByteView input) {
  static const Folder folder;
  folder.clear();
  const auto files = files_of(input);
  folder.write("run.toml", "");
  if (files.contains('t')) folder.write("run.toml", files.at('t'));
  for (const auto& [letter, name] : names) {
    const char recipe = static_cast<char>(letter - 'a' + 'A');
    if (files.contains(letter)) folder.write(name, files.at(letter));
    if (files.contains(recipe)) folder.write(name, npy_of(files.at(recipe)));
  }
  if (files.contains('t') && text_of(files.at('t')).find("base.sqlite") != std::string_view::npos)
    folder.write("base.sqlite", base());
  const std::string out = folder / "out.sqlite";
  bool done = false;
  refused_or_done(
      {ExitCode::failed, ExitCode::config},
      [&] {
        const std::string lines = acquire::import_arrays(folder.path(), out, std::nullopt);
        require(is_printable(lines, "\n"), "the summary can be printed");
        check_run(out);
        done = true;
      },
      true);
  require(done == std::filesystem::exists(out), "a refused folder gives no run");
}
