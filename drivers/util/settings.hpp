// SPDX-License-Identifier: MIT
// Strict settings: plain structs bound to TOML keys. Rejects unknown keys, wrong types and values
// out of range, and reports all faults of a file together. Each report contains
// file:line:column, the expected value and the nearest known key. The struct's initialisers are the
// defaults.
#pragma once
#include <concepts>
#include <cstdint>
#include <functional>
#include <string>
#include <variant>
#include <vector>

#include "drivers/util/exit_code.hpp"

namespace echofuse {

// Reads a whole configuration file. Throws Error(config) if the file cannot be read.
std::string read_config_text(const std::string& path);

// Returns `text` as a TOML string on one line, with quotes and escapes. The TOML library prints
// some strings on several lines, and cannot read them back.
std::string in_quotes(const std::string& text);

// Maximum number of faults that are reported. A file with more faults is probably not TOML.
inline constexpr std::size_t max_faults = 20;

// Throws Error(config) with the given faults, one per line. Only the first `max_faults` are
// included.
[[noreturn]] void refuse(const std::vector<std::string>& faults);

// Returns the known word that is most similar to `word`. If known words begin with `word` (3
// letters or more), returns the shortest of them. Otherwise returns the known word with the
// smallest edit distance. The distance is halved if one word contains the other. Returns an empty
// string if the distance exceeds half of the length of `word`.
std::string nearest(const std::vector<std::string>& known, const std::string& word);

class Settings {
 public:
  // Adds a setting with a dotted key, for example "tdc.bins". `value` must outlive this object.
  void add(std::string key, double& value, double min, double max, std::string doc);
  template <std::integral T>
  void add(std::string key, T& value, std::int64_t min, std::int64_t max, std::string doc) {
    put(std::move(key), std::move(doc),
        IntegerTarget{[&value] { return static_cast<std::int64_t>(value); },
                      [&value](std::int64_t v) { value = static_cast<T>(v); }, min, max});
  }
  void add(std::string key, bool& value, std::string doc);
  // If `allowed` is not empty, the value must be one of its elements.
  void add(std::string key, std::string& value, std::string doc,
           std::vector<std::string> allowed = {});
  void add(std::string key, std::vector<std::string>& value, std::string doc);

  // Reads the text, then the assignments, which override it. An assignment is "key=value" from a
  // command line; a bare word is a string. Applies the valid values and returns all faults, one per
  // line. Continues after a line that is not TOML, unless this line is a section header.
  std::vector<std::string> read(const std::string& text, const std::string& name,
                                const std::vector<std::string>& assignments);
  // Variants of read() that throw Error(ExitCode::config) with all faults.
  void read_file(const std::string& path);
  void read_text(const std::string& text, const std::string& name);
  void set(const std::string& assignment);

  bool given(const std::string& key) const { return !origin(key).empty(); }
  // Returns where a key's value was set: "FILE:line:column" or "--set key=value". Returns an empty
  // string for a default value.
  std::string origin(const std::string& key) const;
  // refused() returns true if the key's value is not valid. whole() returns true if all lines were
  // valid TOML. Before a check of several keys, whole() must be true and refused() false for each
  // of them.
  bool refused(const std::string& key) const;
  bool whole() const { return whole_; }
  // Returns all values as TOML text that read_text() accepts. If `with_docs` is set, comments
  // contain each key's meaning and range.
  std::string resolved(bool with_docs = false) const;
  // Like resolved(true), but also states the origin of each value in a comment.
  std::string with_origins() const;
  // Returns all settings as JSON: {"schema": 1, "settings": {KEY: {...}, ...}}. Each key has
  // "value" and "help". Numbers also have "min" and "max", and enumerations have "allowed".
  std::string json() const;

 private:
  struct RealTarget {
    double* value;
    double min, max;
  };
  struct IntegerTarget {
    std::function<std::int64_t()> value;
    std::function<void(std::int64_t)> set;
    std::int64_t min, max;
  };
  struct TextTarget {
    std::string* value;
    std::vector<std::string> allowed;
  };
  using Target =
      std::variant<RealTarget, IntegerTarget, bool*, TextTarget, std::vector<std::string>*>;
  struct Setting {
    std::string key, doc;
    Target target;
    std::string origin{};
    bool refused = false;
  };
  using FaultList = std::vector<std::string>;
  template <class Node>
  static std::string assign(Setting& entry, const Node& node, const std::string& origin);
  template <class Table>
  void read_table(const Table& table, const std::string& prefix, const std::string& name,
                  FaultList& faults);
  template <class Node>
  std::string unknown(const std::string& key, const Node& node) const;
  void parse(std::string text, const std::string& name, FaultList& faults);
  void take(const std::string& assignment, FaultList& faults);
  void put(std::string key, std::string doc, Target target);
  Setting* find(const std::string& key);
  bool is_section(const std::string& key) const;
  std::vector<std::string> keys() const;
  static std::string expectation(const Setting& entry);
  static std::string value_of(const Setting& entry);
  std::vector<const Setting*> by_section() const;
  std::string print(bool with_docs, bool with_origin) const;

  std::vector<Setting> entries_;
  bool whole_ = true;
};

}  // namespace echofuse
