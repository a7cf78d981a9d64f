// SPDX-License-Identifier: MIT
#include "acquire/config/find_config.hpp"

#include <cstdlib>
#include <filesystem>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/program.hpp"

namespace echofuse::acquire {
namespace {

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

bool named_by_environment() { return !variable("ECHOFUSE_CONFIG").empty(); }

}  // namespace

std::vector<ConfigPlace> config_places() {
  if (named_by_environment()) return {{variable("ECHOFUSE_CONFIG"), "$ECHOFUSE_CONFIG"}};
  std::vector<ConfigPlace> places{{"lab.toml", "./lab.toml"}};
  const std::string own = variable("XDG_CONFIG_HOME"), home = variable("HOME");
  if (own.starts_with('/'))  // the standard: a relative one counts as none
    places.push_back({own + "/echofuse/lab.toml", "$XDG_CONFIG_HOME/echofuse/lab.toml"});
  else if (!home.empty())
    places.push_back({home + "/.config/echofuse/lab.toml", "~/.config/echofuse/lab.toml"});
  places.push_back({"/etc/echofuse/lab.toml", "/etc/echofuse/lab.toml"});
  return places;
}

std::optional<ConfigPlace> find_config() {
  std::error_code none;
  for (const ConfigPlace& place : config_places())
    if (named_by_environment() || std::filesystem::exists(place.path, none)) return place;
  return std::nullopt;
}

ConfigPlace require_config() {
  if (const auto found = find_config()) return *found;
  std::string names;
  for (const ConfigPlace& place : config_places())
    names.append(names.empty() ? "" : ", ") += place.name;
  throw Error(ExitCode::config, "no configuration: there is none of " + names + "; copy " +
                                    (data_folder() / "lab.toml").string() +
                                    ", or name one by --config or $ECHOFUSE_CONFIG");
}

}  // namespace echofuse::acquire
