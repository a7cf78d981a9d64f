// SPDX-License-Identifier: MIT
// Strict settings: plain structs bound to TOML keys. Rejects an unknown key, a wrong type or a
// value out of range, all faults of a file at once. A fault names file:line:column, what was
// expected and the nearest known key. The struct's own initialisers are the defaults.
#pragma once
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "drivers/program/exit_code.hpp"

namespace echofuse {

// A whole configuration file, as it is; throws Error(config) if it cannot be read.
std::string read_config_text(const std::string& path);

// Faults of a text beyond this number are not listed: the text probably is of another kind.
inline constexpr std::size_t max_faults = 20;

// Throws Error(config) that lists the first max_faults of these faults, one per line.
[[noreturn]] void refuse(const std::vector<std::string>& faults);

// Returns the shortest known word that begins with `word` (of 3 letters or more), otherwise the one
// that needs the fewest changes to become it; half as many count where one is a part of the other.
// Empty if that is more than half of its letters.
std::string nearest(const std::vector<std::string>& known, const std::string& word);

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
  void add(std::string key, std::vector<std::string>& value, std::string doc);  // a list of texts

  // Reading: takes what fits and returns every fault, one line each. The text comes first, so that
  // an assignment ("key=value" from a command line; a bare word is a text) wins over it. After a
  // line that is not TOML the lines below it are looked at too, unless it begins a section.
  std::vector<std::string> read(const std::string& text, const std::string& name,
                                const std::vector<std::string>& assignments);
  // Parts of read(); each throws Error(ExitCode::config) that lists every fault.
  void read_file(const std::string& path);
  void read_text(const std::string& text, const std::string& name);
  void set(const std::string& assignment);

  bool given(const std::string& key) const { return !origin(key).empty(); }
  // Origin of a key's value: "FILE:line:column", "--set key=value", or empty for the default.
  std::string origin(const std::string& key) const;
  // Grounds to judge no settings together: the key's value does not fit; or lines of the text are
  // lost, because they are not TOML.
  bool refused(const std::string& key) const;
  bool whole() const { return whole_; }
  // The settings as TOML with all values, which read_text takes back; with each key's meaning and
  // range as a comment if asked.
  std::string resolved(bool with_docs = false) const;
  // TOML as by resolved() with docs, and the origin of each value behind it.
  std::string with_origins() const;
  // JSON object: {KEY: {"value", "help", and "min", "max" of a number, "allowed" of a text that has
  // but some values}, ...}.
  std::string json() const;

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
    std::variant<Real, Integer, bool*, Text, std::vector<std::string>*> target;
    std::string origin{};
    bool refused = false;
  };
  using Faults = std::vector<std::string>;
  template <class Node>
  static std::string assign(Entry& entry, const Node& node, const std::string& origin);
  template <class Table>
  void read_table(const Table& table, const std::string& prefix, const std::string& name,
                  Faults& faults);
  template <class Node>
  std::string unknown(const std::string& key, const Node& node) const;
  void parse(std::string text, const std::string& name, Faults& faults);
  void take(const std::string& assignment, Faults& faults);
  void check_new(const std::string& key) const;
  Entry* find(const std::string& key);
  bool is_section(const std::string& key) const;
  std::vector<std::string> keys() const;
  static std::string expectation(const Entry& entry);
  static std::string value_of(const Entry& entry);
  std::vector<const Entry*> by_section() const;
  std::string print(bool with_docs, bool with_origin) const;

  std::vector<Entry> entries_;
  bool whole_ = true;
};

}  // namespace echofuse
