// SPDX-License-Identifier: MIT
#include "drivers/core/settings.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <fstream>
#include <iterator>
#include <sstream>

#include "drivers/core/printable.hpp"

namespace echofuse {
namespace {

std::string text_of(double v) {
  std::ostringstream out;
  out.precision(15);
  out << v;
  return out.str();
}

std::string literal(double v) {
  const std::string text = text_of(v);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}

// On one line, with escapes: the library's own printer writes some texts with line ends so that it
// does not read them back.
std::string quoted(const std::string& text) {
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

// A bare word is a text. Throws toml::parse_error for one that is not UTF-8.
toml::table parse_value(const std::string& value) {
  try {
    return toml::parse("v = " + value);
  } catch (const toml::parse_error&) {
    static_cast<void>(toml::parse("#" + printable(value)));  // checks the encoding
    return toml::table{{"v", value}};
  }
}

std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] != b[j - 1] ? 1u : 0u)});
      diagonal = above;
    }
  }
  return row.back();
}

[[noreturn]] void fail(const std::vector<std::string>& faults) {
  std::string all;
  for (const auto& f : faults) all.append(all.empty() ? "" : "\n") += printable(f);
  throw Error(ExitCode::config, all);
}

}  // namespace

std::string read_config_text(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  if (!in.is_open() || in.bad())
    throw Error(ExitCode::config, path + ": cannot read; expected a text file");
  return text;
}

void Settings::add(std::string key, double& value, double min, double max, std::string doc) {
  check_new(key);
  entries_.push_back({std::move(key), std::move(doc), Real{&value, min, max}});
}
void Settings::add(std::string key, std::int64_t& value, std::int64_t min, std::int64_t max,
                   std::string doc) {
  check_new(key);
  entries_.push_back({std::move(key), std::move(doc), Integer{&value, min, max}});
}
void Settings::add(std::string key, bool& value, std::string doc) {
  check_new(key);
  entries_.push_back({std::move(key), std::move(doc), &value});
}
void Settings::add(std::string key, std::string& value, std::string doc,
                   std::vector<std::string> allowed) {
  check_new(key);
  entries_.push_back({std::move(key), std::move(doc), Text{&value, std::move(allowed)}});
}

void Settings::check_new([[maybe_unused]] const std::string& key) const {
  assert(
      std::none_of(entries_.begin(), entries_.end(), [&](const Entry& e) { return e.key == key; }));
}

Settings::Entry* Settings::find(const std::string& key) {
  const auto it =
      std::find_if(entries_.begin(), entries_.end(), [&](const Entry& e) { return e.key == key; });
  return it == entries_.end() ? nullptr : &*it;
}

bool Settings::given(const std::string& key) const {
  const auto* entry = const_cast<Settings*>(this)->find(key);
  return entry && entry->given;
}

std::string Settings::nearest(const std::string& key) const {
  const auto it = std::min_element(entries_.begin(), entries_.end(), [&](auto& a, auto& b) {
    return edit_distance(a.key, key) < edit_distance(b.key, key);
  });
  return it == entries_.end() ? "" : it->key;
}

std::string Settings::expectation(const Entry& entry) {
  if (const auto* r = std::get_if<Real>(&entry.target))
    return "a number from " + text_of(r->min) + " to " + text_of(r->max);
  if (const auto* i = std::get_if<Integer>(&entry.target))
    return "a whole number from " + std::to_string(i->min) + " to " + std::to_string(i->max);
  if (std::holds_alternative<bool*>(entry.target)) return "true or false";
  const auto& allowed = std::get<Text>(entry.target).allowed;
  if (allowed.empty()) return "a text in quotes";
  std::string list = "one of";
  for (const auto& a : allowed) list += " \"" + a + "\"";
  return list;
}

// Sets the entry from a TOML node; returns what was expected if it does not fit.
template <class Node>
std::string Settings::assign(Entry& entry, const Node& node) {
  bool fits = false;
  if (auto* r = std::get_if<Real>(&entry.target)) {
    if (node.is_number()) {
      const double v = *node.template value<double>();
      fits = std::isfinite(v) && v >= r->min && v <= r->max;
      if (fits) *r->value = v;
    }
  } else if (auto* i = std::get_if<Integer>(&entry.target)) {
    if (node.is_integer()) {
      const auto v = *node.template value<std::int64_t>();
      fits = v >= i->min && v <= i->max;
      if (fits) *i->value = v;
    }
  } else if (auto* b = std::get_if<bool*>(&entry.target)) {
    fits = node.is_boolean();
    if (fits) **b = *node.template value<bool>();
  } else {
    auto& t = std::get<Text>(entry.target);
    if (node.is_string()) {
      const auto v = *node.template value<std::string>();
      fits =
          t.allowed.empty() || std::find(t.allowed.begin(), t.allowed.end(), v) != t.allowed.end();
      if (fits) *t.value = v;
    }
  }
  entry.given = entry.given || fits;
  return fits ? "" : expectation(entry);
}

template <class Table>
void Settings::read_table(const Table& table, const std::string& prefix, const std::string& name,
                          std::vector<std::string>& faults) {
  for (const auto& [raw_key, node] : table) {
    const std::string key = prefix + std::string(raw_key.str());
    const auto where = raw_key.source().begin;
    const std::string place =
        name + ":" + std::to_string(where.line) + ":" + std::to_string(where.column) + ": ";
    Entry* entry = find(key);
    const bool is_section = std::any_of(entries_.begin(), entries_.end(), [&](const Entry& e) {
      return e.key.rfind(key + ".", 0) == 0;
    });
    if (!entry && is_section && node.is_table()) {
      read_table(*node.as_table(), key + ".", name, faults);
    } else if (!entry) {
      faults.push_back(place + "unknown key \"" + key + "\"; the nearest known one is \"" +
                       nearest(key) + "\"");
    } else if (const std::string expected = assign(*entry, node); !expected.empty()) {
      std::ostringstream got;
      node.visit([&](const auto& n) {
        if constexpr (requires { got << n; }) got << n;
      });
      faults.push_back(place + key + " = " + got.str() + " does not fit; expected " + expected);
    }
  }
}

void Settings::read_text(const std::string& text, const std::string& name) {
  std::vector<std::string> faults;
  try {
    const toml::table table = toml::parse(text, name);
    read_table(table, "", name, faults);
  } catch (const toml::parse_error& e) {
    const auto where = e.source().begin;
    faults.push_back(name + ":" + std::to_string(where.line) + ":" + std::to_string(where.column) +
                     ": not TOML: " + std::string(e.description()));
  }
  if (!faults.empty()) fail(faults);
}

void Settings::read_file(const std::string& path) { read_text(read_config_text(path), path); }

void Settings::set(const std::string& assignment) {
  const auto equals = assignment.find('=');
  const auto complain = [&](const std::string& what) {
    throw Error(ExitCode::config, printable("--set " + assignment + ": " + what));
  };
  if (equals == std::string::npos) complain("expected key=value");
  const std::string key = assignment.substr(0, equals);
  const std::string value = assignment.substr(equals + 1);
  Entry* entry = find(key);
  if (!entry) complain("unknown key; the nearest known one is \"" + nearest(key) + "\"");
  toml::table table;
  try {
    table = parse_value(value);
  } catch (const toml::parse_error&) {
    complain("expected UTF-8");
  }
  const std::string expected =
      table.size() == 1 ? assign(*entry, *table.get("v")) : expectation(*entry);
  if (!expected.empty()) complain("expected " + expected);
}

std::string Settings::resolved(bool with_docs) const {
  // Keys without a section first, then each section once.
  std::vector<const Entry*> order;
  for (const auto& e : entries_) order.push_back(&e);
  const auto section = [](const Entry* e) {
    const auto dot = e->key.rfind('.');
    return dot == std::string::npos ? std::string() : e->key.substr(0, dot);
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](auto* a, auto* b) { return section(a).empty() && !section(b).empty(); });
  std::ostringstream out;
  std::string current;
  for (const auto* e : order) {
    if (section(e) != current) out << "\n[" << (current = section(e)) << "]\n";
    if (with_docs) out << "# " << e->doc << " (" << expectation(*e) << ")\n";
    out << e->key.substr(current.empty() ? 0 : current.size() + 1) << " = ";
    if (const auto* r = std::get_if<Real>(&e->target))
      out << literal(*r->value);
    else if (const auto* i = std::get_if<Integer>(&e->target))
      out << *i->value;
    else if (const auto* b = std::get_if<bool*>(&e->target))
      out << (**b ? "true" : "false");
    else
      out << quoted(*std::get<Text>(e->target).value);
    out << "\n";
  }
  return out.str();
}

}  // namespace echofuse
