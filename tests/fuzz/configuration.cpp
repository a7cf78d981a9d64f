// SPDX-License-Identifier: MIT
// Input: the files lab.toml (l), calibration.toml (c) and radar.cfg (r) in the format of files.hpp.
#include "acquire/config/config.hpp"
#include "files.hpp"

namespace {

std::string contents(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void check_config(const fuzz::Folder& folder) {
  const acquire::Config config = acquire::load_config(folder / "lab.toml");
  require(!config.configured().empty(), "a configuration has a device");
  require((config.required() - config.configured()).empty(), "required devices have an address");
  for (const Sensor sensor : all_sensors)
    require(config.nominal_hz()[sensor] >= 0, "a rate is not negative");
  require(config.antennas.size() <= record::max_antennas, "antennas are limited");
  folder.write("lab.toml", config.resolved);
  fuzz::refused_or_done({}, [&] {
    require(acquire::load_config(folder / "lab.toml").resolved == config.resolved,
            "the resolved configuration reads back unchanged");
  });
}

void check_calibration(const fuzz::Folder& folder) {
  const std::string first = folder / "first.toml", second = folder / "second.toml";
  acquire::write_calibration(first, acquire::read_calibration(folder / "calibration.toml"));
  // No error is allowed, because a written calibration must be readable.
  fuzz::refused_or_done(
      {}, [&] { acquire::write_calibration(second, acquire::read_calibration(first)); });
  require(contents(first) == contents(second), "a written calibration reads back unchanged");
}

}  // namespace

void fuzz::run(ByteView input) {
  static const Folder folder;
  write_files(folder, files_of(input),
              {{'l', "lab.toml"}, {'c', "calibration.toml"}, {'r', "radar.cfg"}});
  refused_or_done(
      {ExitCode::config}, [] { check_calibration(folder); }, true);
  refused_or_done(
      {ExitCode::config}, [] { check_config(folder); }, true);
}
