// SPDX-License-Identifier: MIT
#include "drivers/util/settings.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <sstream>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse {
namespace {

// Formats a number with 15 digits, or with 17 digits if 15 digits would be read back as a different
// number.
std::string text_of(double v) {
  const std::string text = format("%.15g", v);
  return std::strtod(text.c_str(), nullptr) == v ? text : format("%.17g", v);
}

std::string literal(double v) {
  const std::string text = text_of(v);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}

// Parses a TOML value. A bare word is a string. Throws toml::parse_error if the text is not UTF-8.
toml::table parse_value(const std::string& value) {
  try {
    return toml::parse("v = " + value);
  } catch (const toml::parse_error&) {
    std::string comment = "#" + value;  // parsed only to check the encoding
    std::replace_if(
        comment.begin(), comment.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; }, '?');
    static_cast<void>(toml::parse(comment));
    return toml::table{{"v", value}};
  }
}

// Returns the shortest known name that begins with `text`. Returns an empty string if no name
// matches, or if `text` has fewer than 3 letters.
std::string begun_by(const std::vector<std::string>& known, const std::string& text) {
  constexpr std::size_t telling = 3;
  std::string out;
  for (const auto& name : known)
    if (text.size() >= telling && name.starts_with(text) &&
        (out.empty() || name.size() < out.size()))
      out = name;
  return out;
}

std::string or_nearest(const std::vector<std::string>& known, const std::string& key) {
  const std::string name = nearest(known, key);
  return name.empty() ? "; no similar name" : "; the most similar known name is \"" + name + "\"";
}

std::string section_of(const std::string& key) {
  const auto dot = key.rfind('.');
  return dot == std::string::npos ? "" : key.substr(0, dot);
}

std::string place(const std::string& name, const toml::source_position& where) {
  return name + ":" + std::to_string(where.line) + ":" + std::to_string(where.column);
}

// Returns line n, counted from 1. Returns an empty string after the last line.
std::string_view line_of(std::string_view text, std::size_t n) {
  while (--n > 0) text.remove_prefix(std::min(text.find('\n'), text.size() - 1) + 1);
  return text.substr(0, text.find('\n'));
}

// Removes the contents of a line that is not TOML. Returns false if later lines depend on it, as
// after a section header or in an open multi-line string.
bool blank_out(std::string& text, std::size_t n) {
  const std::string_view line = line_of(text, n);
  const std::size_t first = line.find_first_not_of(" \t\r");
  if (first == line.npos || line[first] == '[') return false;
  text.erase(static_cast<std::size_t>(line.data() - text.data()), line.size());
  return true;
}

}  // namespace

std::string in_quotes(const std::string& text) {
  constexpr char digits[] = "0123456789abcdef";
  std::string out = "\"";
  for (const char c : text) {
    const auto code = static_cast<unsigned char>(c);
    if (code < 0x20 || code == 0x7f)
      out.append("\\u00") += {digits[code >> 4], digits[code & 15]};
    else
      out.append(c == '"' || c == '\\' ? "\\" : "") += c;
  }
  return out + '"';
}

void refuse(const std::vector<std::string>& faults) {
  std::string all;
  for (std::size_t i = 0; i < std::min(faults.size(), max_faults); ++i)
    all.append(i == 0 ? "" : "\n") += printable(faults[i]);
  if (faults.size() > max_faults)
    all += "\nthere are more errors; the list ends after the first " + std::to_string(max_faults);
  throw Error(ExitCode::config, all);
}

std::string read_config_text(const std::string& path) {
  constexpr std::size_t longest = 64u << 20;
  auto text = RegularFile(path, ExitCode::config).rest<std::string>(longest);
  if (text.size() > longest)
    throw Error(ExitCode::config, printable(path) + ": has more than 64 MiB; expected a text file");
  if (text.find('\0') != text.npos)
    throw Error(ExitCode::config, printable(path) +
                                      ": is UTF-16 or not a text file; save it as "
                                      "UTF-8 or ASCII");
  return text;
}

void Settings::add(std::string key, double& value, double min, double max, std::string doc) {
  put(std::move(key), std::move(doc), RealTarget{&value, min, max});
}
void Settings::add(std::string key, bool& value, std::string doc) {
  put(std::move(key), std::move(doc), &value);
}
void Settings::add(std::string key, std::string& value, std::string doc,
                   std::vector<std::string> allowed) {
  put(std::move(key), std::move(doc), TextTarget{&value, std::move(allowed)});
}

void Settings::add(std::string key, std::vector<std::string>& value, std::string doc) {
  put(std::move(key), std::move(doc), &value);
}

void Settings::put(std::string key, std::string doc, Target target) {
  assert(!find(key));
  entries_.push_back({std::move(key), std::move(doc), std::move(target)});
}

Settings::Setting* Settings::find(const std::string& key) {
  const auto it = std::ranges::find(entries_, key, &Setting::key);
  return it == entries_.end() ? nullptr : &*it;
}

std::string Settings::origin(const std::string& key) const {
  const auto* entry = const_cast<Settings*>(this)->find(key);
  return entry ? entry->origin : "";
}

bool Settings::refused(const std::string& key) const {
  const auto* entry = const_cast<Settings*>(this)->find(key);
  return entry && entry->refused;
}

bool Settings::is_section(const std::string& key) const {
  return std::ranges::any_of(entries_,
                             [&](const Setting& e) { return e.key.starts_with(key + "."); });
}

std::vector<std::string> Settings::keys() const {
  std::vector<std::string> out;
  for (const auto& e : entries_) out.push_back(e.key);
  return out;
}

std::string Settings::expectation(const Setting& entry) {
  if (const auto* r = std::get_if<RealTarget>(&entry.target))
    return "a number from " + text_of(r->min) + " to " + text_of(r->max);
  if (const auto* i = std::get_if<IntegerTarget>(&entry.target))
    return "a whole number from " + std::to_string(i->min) + " to " + std::to_string(i->max);
  if (std::holds_alternative<bool*>(entry.target)) return "true or false";
  if (std::holds_alternative<std::vector<std::string>*>(entry.target))
    return "a list of quoted strings";
  const auto& allowed = std::get<TextTarget>(entry.target).allowed;
  if (allowed.empty()) return "a quoted string";
  std::string list = "one of";
  for (const auto& a : allowed) list += " \"" + a + "\"";
  return list;
}

// Sets the entry from a TOML node. If the node is not valid, returns a description of valid values.
template <class Node>
std::string Settings::assign(Setting& entry, const Node& node, const std::string& origin) {
  bool fits = false;
  if (auto* r = std::get_if<RealTarget>(&entry.target)) {
    if (node.is_number()) {
      const double v = *node.template value<double>();
      fits = std::isfinite(v) && v >= r->min && v <= r->max;
      if (fits) *r->value = v;
    }
  } else if (auto* i = std::get_if<IntegerTarget>(&entry.target)) {
    if (node.is_integer()) {
      const auto v = *node.template value<std::int64_t>();
      fits = v >= i->min && v <= i->max;
      if (fits) i->set(v);
    }
  } else if (auto* b = std::get_if<bool*>(&entry.target)) {
    fits = node.is_boolean();
    if (fits) **b = *node.template value<bool>();
  } else if (auto* list = std::get_if<std::vector<std::string>*>(&entry.target)) {
    std::vector<std::string> texts;
    if (const auto* array = node.as_array())
      for (const auto& item : *array)
        if (const auto text = item.template value<std::string>()) texts.push_back(*text);
    fits = node.is_array() && texts.size() == node.as_array()->size();
    if (fits) **list = texts;
  } else {
    auto& t = std::get<TextTarget>(entry.target);
    if (node.is_string()) {
      const auto v = *node.template value<std::string>();
      fits =
          t.allowed.empty() || std::find(t.allowed.begin(), t.allowed.end(), v) != t.allowed.end();
      if (fits) *t.value = v;
    }
  }
  if (fits) entry.origin = origin;
  entry.refused = !fits;
  return fits ? "" : expectation(entry);
}

template <class Node>
std::string Settings::unknown(const std::string& key, const Node& node) const {
  if (is_section(key)) return key + " is a section; expected [" + key + "] and its keys below";
  std::vector<std::string> known = keys();
  if (node.is_table())
    for (auto& name : known) name = section_of(name);
  std::erase(known, "");
  return "unknown " + std::string(node.is_table() ? "section" : "key") + " \"" + key + "\"" +
         or_nearest(known.empty() ? keys() : known, key);
}

template <class Table>
void Settings::read_table(const Table& table, const std::string& prefix, const std::string& name,
                          FaultList& faults) {
  // order of the keys in the file, because the table is sorted by name
  std::vector<typename Table::const_iterator> order;
  for (auto it = table.cbegin(); it != table.cend(); ++it) order.push_back(it);
  std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) {
    return a->first.source().begin < b->first.source().begin;
  });
  for (const auto& it : order) {
    if (faults.size() > max_faults) return;
    const auto& node = it->second;
    const std::string key = prefix + std::string(it->first.str());
    const std::string here = place(name, it->first.source().begin);
    Setting* entry = find(key);
    if (!entry && node.is_table() && is_section(key)) {
      read_table(*node.as_table(), key + ".", name, faults);
    } else if (!entry) {
      faults.push_back(here + ": " + unknown(key, node));
    } else if (const std::string expected = assign(*entry, node, here); !expected.empty()) {
      std::ostringstream got;
      node.visit([&](const auto& n) {
        if constexpr (requires { got << n; }) got << n;
      });
      faults.push_back(here + ": " + key + " = " + got.str() + " is not valid; expected " +
                       expected);
    }
  }
}

void Settings::parse(std::string text, const std::string& name, FaultList& faults) {
  std::size_t last = 0;
  for (std::size_t rounds = 0; rounds < max_faults; ++rounds) {
    try {
      return read_table(toml::parse(text, name), "", name, faults);
    } catch (const toml::parse_error& e) {
      whole_ = false;
      const auto where = e.source().begin;
      if (where.line <= last) return;
      // Does not report the continuation lines of a value if the value's first line is faulty.
      if (last == 0 || line_of(text, where.line).find('=') != std::string_view::npos)
        faults.push_back(place(name, where) + ": not TOML: " + std::string(e.description()));
      if (!blank_out(text, where.line)) return;
      last = where.line;
    }
  }
}

void Settings::take(const std::string& assignment, FaultList& faults) {
  const std::string origin = "--set " + assignment;
  const auto complain = [&](const std::string& what) { faults.push_back(origin + ": " + what); };
  const auto equals = assignment.find('=');
  if (equals == std::string::npos) return complain("expected key=value");
  const std::string key = assignment.substr(0, equals);
  Setting* entry = find(key);
  if (!entry) return complain("unknown key" + or_nearest(keys(), key));
  try {
    const std::string value = assignment.substr(equals + 1);
    toml::table table = parse_value(value);
    // Accepts a string without quotes, even if it looks like a number.
    if (std::holds_alternative<TextTarget>(entry->target) && table.get("v")->is_value() &&
        !table.get("v")->is_string())
      table.insert_or_assign("v", value);
    const std::string expected =
        table.size() == 1 ? assign(*entry, *table.get("v"), origin) : expectation(*entry);
    const std::string longer = begun_by(keys(), key + "_");
    if (!expected.empty())
      complain("expected " + expected +
               (longer.empty() ? "" : "; there is another key \"" + longer + "\""));
  } catch (const toml::parse_error&) {
    complain("expected UTF-8");
  }
}

std::vector<std::string> Settings::read(const std::string& text, const std::string& name,
                                        const std::vector<std::string>& assignments) {
  FaultList faults;
  parse(text, name, faults);
  for (const auto& assignment : assignments) take(assignment, faults);
  return faults;
}

void Settings::read_text(const std::string& text, const std::string& name) {
  if (const FaultList faults = read(text, name, {}); !faults.empty()) refuse(faults);
}

void Settings::read_file(const std::string& path) { read_text(read_config_text(path), path); }

void Settings::set(const std::string& assignment) {
  FaultList faults;
  take(assignment, faults);
  if (!faults.empty()) refuse(faults);
}

std::string Settings::value_of(const Setting& entry) {
  if (const auto* r = std::get_if<RealTarget>(&entry.target)) return literal(*r->value);
  if (const auto* i = std::get_if<IntegerTarget>(&entry.target)) return std::to_string(i->value());
  if (const auto* b = std::get_if<bool*>(&entry.target)) return **b ? "true" : "false";
  if (const auto* list = std::get_if<std::vector<std::string>*>(&entry.target)) {
    std::string out;
    for (const auto& text : **list) out += (out.empty() ? "[" : ", ") + in_quotes(text);
    return out.empty() ? "[]" : out + "]";
  }
  return in_quotes(*std::get<TextTarget>(entry.target).value);
}

// Returns the keys that have no section, followed by the keys of each section, because TOML rejects
// repeated sections. Sections and keys keep the order in which they were added.
std::vector<const Settings::Setting*> Settings::by_section() const {
  std::vector<std::string> sections{""};
  std::vector<const Setting*> out;
  for (const auto& e : entries_) {
    out.push_back(&e);
    const std::string section = section_of(e.key);
    if (std::find(sections.begin(), sections.end(), section) == sections.end())
      sections.push_back(section);
  }
  const auto rank = [&](const Setting* e) {
    return std::find(sections.begin(), sections.end(), section_of(e->key));
  };
  std::stable_sort(out.begin(), out.end(), [&](auto* a, auto* b) { return rank(a) < rank(b); });
  return out;
}

std::string Settings::print(bool with_docs, bool with_origin) const {
  std::string out, current;
  for (const auto* e : by_section()) {
    if (section_of(e->key) != current) out += "\n[" + (current = section_of(e->key)) + "]\n";
    if (with_docs) out += "# " + e->doc + " (" + expectation(*e) + ")\n";
    out += e->key.substr(current.empty() ? 0 : current.size() + 1) + " = " + value_of(*e);
    if (with_origin) out += "  # " + (e->origin.empty() ? "default" : printable(e->origin));
    out += "\n";
  }
  return out;
}

std::string Settings::resolved(bool with_docs) const { return print(with_docs, false); }

std::string Settings::with_origins() const { return print(true, true); }

// value_of() prints TOML, which is also valid JSON for the numbers, strings and booleans used here.
std::string Settings::json() const {
  std::string out;
  for (const Setting& e : entries_) {
    out += (out.empty() ? "  " : ",\n  ") + in_quotes(e.key) + ": {\"value\": " + value_of(e);
    const auto bounds = [&](const auto& target, const auto& text) {
      out += ", \"min\": " + text(target.min) + ", \"max\": " + text(target.max);
    };
    if (const auto* r = std::get_if<RealTarget>(&e.target)) bounds(*r, text_of);
    if (const auto* i = std::get_if<IntegerTarget>(&e.target))
      bounds(*i, [](std::int64_t v) { return std::to_string(v); });
    if (const auto* t = std::get_if<TextTarget>(&e.target); t && !t->allowed.empty()) {
      out += ", \"allowed\": ";
      for (const auto& a : t->allowed) out += (&a == t->allowed.data() ? "[" : ", ") + in_quotes(a);
      out += "]";
    }
    out += ", \"help\": " + in_quotes(e.doc) + "}";
  }
  return "{\"schema\": 1, \"settings\": {\n" + out + "\n}}\n";
}

namespace {

// Returns the edit distance. Edits are insertion, deletion, substitution and transposition of two
// adjacent letters.
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::vector<std::size_t>> at(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i)
    for (std::size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        at[i][j] = i + j;
        continue;
      }
      at[i][j] = std::min({at[i - 1][j] + 1, at[i][j - 1] + 1,
                           at[i - 1][j - 1] + (a[i - 1] != b[j - 1] ? 1u : 0u)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        at[i][j] = std::min(at[i][j], at[i - 2][j - 2] + 1);
    }
  return at[a.size()][b.size()];
}

}  // namespace

std::string nearest(const std::vector<std::string>& known, const std::string& key) {
  const std::string begun = begun_by(known, key);
  if (!begun.empty()) return begun;
  const auto changes = [&](const std::string& name) {
    const bool part = key.find(name) != key.npos || name.find(key) != name.npos;
    return edit_distance(name, key) * (part ? 1 : 2);
  };
  const auto it = std::min_element(known.begin(), known.end(),
                                   [&](auto& a, auto& b) { return changes(a) < changes(b); });
  return it == known.end() || changes(*it) > key.size() ? "" : *it;
}

}  // namespace echofuse
