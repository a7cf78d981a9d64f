// SPDX-License-Identifier: MIT
// Strict settings: plain structs bound to TOML keys. An unknown key, a wrong type or a value out of
// range is reported with file:line:column, what was expected and the nearest known key, and all
// faults of a file at once. The struct's own initialisers are the defaults.
#pragma once
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "drivers/core/exit_code.hpp"

namespace echofuse {

// A whole configuration file, as it is; throws Error(config) if it cannot be read.
std::string read_config_text(const std::string& path);

class Settings {
 public:
  // Binding. Keys are dotted ("tdc.bins"); the reference must outlive this object.
  void add(std::string key, double& value, double min, double max, std::string doc);
  void add(std::string key, std::int64_t& value, std::int64_t min, std::int64_t max,
           std::string doc);
  void add(std::string key, bool& value, std::string doc);
  // Any text, or one of `allowed` if that is not empty.
  void add(std::string key, std::string& value, std::string doc,
           std::vector<std::string> allowed = {});

  // Reading. Each throws Error(ExitCode::config) that lists every fault, one a line.
  void read_file(const std::string& path);
  void read_text(const std::string& text, const std::string& name);
  // "key=value" from a command line; a bare word is taken as text where text is expected.
  void set(const std::string& assignment);

  bool given(const std::string& key) const;
  // The settings as TOML with all values, which read_text takes back; with each key's meaning and
  // range as a comment if asked.
  std::string resolved(bool with_docs = false) const;

 private:
  struct Real {
    double* value;
    double min, max;
  };
  struct Integer {
    std::int64_t* value;
    std::int64_t min, max;
  };
  struct Text {
    std::string* value;
    std::vector<std::string> allowed;
  };
  struct Entry {
    std::string key, doc;
    std::variant<Real, Integer, bool*, Text> target;
    bool given = false;
  };
  template <class Node>
  std::string assign(Entry& entry, const Node& node);
  template <class Table>
  void read_table(const Table& table, const std::string& prefix, const std::string& name,
                  std::vector<std::string>& faults);
  void check_new(const std::string& key) const;
  Entry* find(const std::string& key);
  std::string nearest(const std::string& key) const;
  static std::string expectation(const Entry& entry);

  std::vector<Entry> entries_;
};

}  // namespace echofuse
