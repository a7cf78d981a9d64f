// SPDX-License-Identifier: MIT
// Reads the [[kind]] tables of a TOML file and collects all mistakes. Include this header only in
// .cpp files, because toml++ is a large header.
#pragma once
#include <toml++/toml.h>

#include <string>
#include <utility>
#include <vector>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::sim {

class TableReader {
 public:
  explicit TableReader(std::string file_name) : name_(std::move(file_name)) {}

 protected:
  // Calls use(table) for each [[kind]] table. Reports anything else in the file as a mistake.
  // Throws Error(config) if the text is not valid TOML.
  template <class Use>
  void read_tables(const std::string& text, const std::string& kind, Use use) try {
    const toml::table file = toml::parse(text, name_);
    for (const auto& [key, node] : file)
      if (key.str() != kind || !node.is_array_of_tables())
        say(node, std::string(key.str()) + ": expected [[" + kind + "]] tables only");
    if (const auto* list = file[kind].as_array())
      for (const auto& node : *list)
        if (const auto* table = node.as_table()) use(*table);
  } catch (const toml::parse_error& e) {
    refuse({place(e) + "not TOML: " + std::string(e.description())});
  }
  template <class Node>
  void say(const Node& node, const std::string& what) {
    faults_.push_back(place(node) + what);
  }
  void refuse_faults() const {
    if (!faults_.empty()) refuse(faults_);
  }

  template <class Node>
  std::string place(const Node& node) const {
    const auto where = node.source().begin;
    return name_ + ":" + std::to_string(where.line) + ":" + std::to_string(where.column) + ": ";
  }

  std::string name_;
  std::vector<std::string> faults_;
};

}  // namespace echofuse::sim
