// SPDX-License-Identifier: MIT
// Strict settings: plain structs bound to TOML keys. Rejects unknown keys, wrong types and values
// out of range, and reports all faults of a file at once. A fault names file:line:column, the
// expected value and the nearest known key. The struct's initialisers are the defaults.
#pragma once
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "drivers/util/exit_code.hpp"

namespace echofuse {

// Reads a whole configuration file; throws Error(config) if it cannot be read.
std::string read_config_text(const std::string& path);

// Limit of listed faults: a text with more is probably not TOML.
inline constexpr std::size_t max_faults = 20;

// Throws Error(config) with the first max_faults of these faults, one per line.
[[noreturn]] void refuse(const std::vector<std::string>& faults);

// Returns the shortest known word that begins with `word` (of 3 letters or more), otherwise the one
// with the smallest edit distance. The distance counts half if one word contains the other. Empty
// if it exceeds half of the word's length.
std::string nearest(const std::vector<std::string>& known, const std::string& word);

class Settings {
 public:
  // Binds a dotted key ("tdc.bins"). The reference must outlive this object.
  void add(std::string key, double& value, double min, double max, std::string doc);
  void add(std::string key, std::int64_t& value, std::int64_t min, std::int64_t max,
           std::string doc);
  void add(std::string key, bool& value, std::string doc);
  // Any text, or one of `allowed` if that is not empty.
  void add(std::string key, std::string& value, std::string doc,
           std::vector<std::string> allowed = {});
  void add(std::string key, std::vector<std::string>& value, std::string doc);  // list of strings

  // Reads the text, then the assignments, which override it ("key=value" from a command line; a
  // bare word is a string). Sets valid values and returns all faults, one per line. After a line
  // that is not TOML it continues with the next line, unless the bad line is a section header.
  std::vector<std::string> read(const std::string& text, const std::string& name,
                                const std::vector<std::string>& assignments);
  // Variants of read(); each throws Error(ExitCode::config) with all faults.
  void read_file(const std::string& path);
  void read_text(const std::string& text, const std::string& name);
  void set(const std::string& assignment);

  bool given(const std::string& key) const { return !origin(key).empty(); }
  // Returns the origin of a key's value: "FILE:line:column", "--set key=value", or empty for the
  // default.
  std::string origin(const std::string& key) const;
  // refused(): the key's value is invalid. whole(): no line was skipped as not TOML. A cross-check
  // requires whole(), and !refused() for each of its keys.
  bool refused(const std::string& key) const;
  bool whole() const { return whole_; }
  // Returns all values as TOML that read_text accepts, optionally with each key's meaning and range
  // as a comment.
  std::string resolved(bool with_docs = false) const;
  // Like resolved() with docs, and with the origin after each value.
  std::string with_origins() const;
  // Returns a JSON object: {KEY: {"value", "help", "min" and "max" of a number, "allowed" of an
  // enumeration}, ...}.
  std::string json() const;

 private:
  struct RealTarget {
    double* value;
    double min, max;
  };
  struct IntegerTarget {
    std::int64_t* value;
    std::int64_t min, max;
  };
  struct TextTarget {
    std::string* value;
    std::vector<std::string> allowed;
  };
  struct Setting {
    std::string key, doc;
    std::variant<RealTarget, IntegerTarget, bool*, TextTarget, std::vector<std::string>*> target;
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
  void check_new(const std::string& key) const;
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
