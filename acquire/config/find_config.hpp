// SPDX-License-Identifier: MIT
// Where a configuration stands that no option names.
#pragma once
#include <optional>
#include <string>
#include <vector>

namespace echofuse::acquire {

struct ConfigPlace {
  std::string path;
  std::string name;  // as a text calls it: "$ECHOFUSE_CONFIG", "./lab.toml"
};

// In the order in which they are looked at: $ECHOFUSE_CONFIG if it is set (then no other),
// ./lab.toml, $XDG_CONFIG_HOME/echofuse/lab.toml (by default in ~/.config),
// /etc/echofuse/lab.toml.
std::vector<ConfigPlace> config_places();

// The first that is there. What $ECHOFUSE_CONFIG names need not be: it was asked for.
std::optional<ConfigPlace> find_config();

// The same; without one an Error(config) that names all places.
ConfigPlace require_config();

}  // namespace echofuse::acquire
