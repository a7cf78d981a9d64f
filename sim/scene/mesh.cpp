// SPDX-License-Identifier: MIT
#include "sim/scene/mesh.hpp"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <string_view>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"
#include "drivers/program/settings.hpp"

namespace echofuse::sim {
namespace {

constexpr std::size_t most_triangles = 1'000'000;
constexpr std::uint64_t most_elements = 10'000'000;
constexpr double farthest = 1e6;  // largest coordinate: anything beyond is damage

// Reads the words of a text, line by line.
class Text {
 public:
  Text(std::string_view text, const std::string& name) : text_(text), name_(name) {}

  bool next_line() {
    if (at_ >= text_.size()) return false;
    const std::size_t end = std::min(text_.find('\n', at_), text_.size());
    rest_ = text_.substr(at_, end - at_);
    at_ = end + 1;
    ++line_;
    return true;
  }
  // The word is empty at the end of the line.
  std::string_view word() {
    const std::size_t begin = std::min(rest_.find_first_not_of(" \t\r"), rest_.size());
    const std::size_t end = std::min(rest_.find_first_of(" \t\r", begin), rest_.size());
    const std::string_view found = rest_.substr(begin, end - begin);
    rest_.remove_prefix(end);
    return found;
  }
  std::size_t after_line() const { return std::min(at_, text_.size()); }

  template <class Number>
  Number number(std::string_view word, const char* expected) const {
    Number value{};
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size()) fail(word, expected);
    return value;
  }
  double coordinate(std::string_view word) const {
    const auto value = number<double>(word, "a coordinate");
    if (!(std::abs(value) <= farthest)) fail(word, "a coordinate of at most 1e6");
    return value;
  }
  [[noreturn]] void fail(std::string_view found, const std::string& expected) const {
    throw Error(ExitCode::config, name_ + ":" + std::to_string(line_) + ": found \"" +
                                      printable(std::string(found.substr(0, 40))) +
                                      "\"; expected " + expected);
  }

 private:
  std::string_view text_, rest_;
  const std::string& name_;
  std::size_t at_ = 0, line_ = 0;
};

// Adds the fan of a polygon.
void add_polygon(Mesh& mesh, const std::vector<std::uint32_t>& corners) {
  for (std::size_t i = 2; i < corners.size(); ++i) {
    const Vec3 a = mesh.points[corners[0]], b = mesh.points[corners[i - 1]],
               c = mesh.points[corners[i]];
    if (length(cross(b - a, c - a)) > 0)
      mesh.triangles.push_back({corners[0], corners[i - 1], corners[i]});
  }
}

void check_size(const Mesh& mesh, const std::string& name) {
  if (mesh.triangles.empty())
    throw Error(ExitCode::config, name + ": no triangles; expected a mesh with faces");
  if (mesh.triangles.size() > most_triangles)
    throw Error(ExitCode::config, name + ": " + std::to_string(mesh.triangles.size()) +
                                      " triangles; expected at most a million");
}

// Indices count from 1, or backwards from -1.
std::uint32_t obj_corner(const Text& text, std::string_view word, std::size_t points) {
  const auto index = text.number<std::int64_t>(word.substr(0, word.find('/')), "a vertex index");
  const auto count = static_cast<std::int64_t>(points);
  if (index == 0 || index > count || index < -count)
    text.fail(word, "a vertex index from 1 to " + std::to_string(count));
  return static_cast<std::uint32_t>(index > 0 ? index - 1 : count + index);
}

Mesh read_obj(std::string_view content, const std::string& name) {
  Mesh mesh;
  Text text(content, name);
  std::vector<std::uint32_t> corners;
  while (text.next_line()) {
    const std::string_view key = text.word();
    if (key == "v") {
      const double x = text.coordinate(text.word()), y = text.coordinate(text.word());
      mesh.points.push_back({x, y, text.coordinate(text.word())});
    } else if (key == "f") {
      corners.clear();
      for (auto word = text.word(); !word.empty(); word = text.word())
        corners.push_back(obj_corner(text, word, mesh.points.size()));
      if (corners.size() < 3) text.fail(key, "at least three corners of a face");
      add_polygon(mesh, corners);
    }
  }
  return mesh;
}

struct PlyType {
  const char *name, *other_name;
  std::size_t bytes;
  char kind;  // i, u, f
};
constexpr std::array<PlyType, 8> ply_types{{{"char", "int8", 1, 'i'},
                                            {"uchar", "uint8", 1, 'u'},
                                            {"short", "int16", 2, 'i'},
                                            {"ushort", "uint16", 2, 'u'},
                                            {"int", "int32", 4, 'i'},
                                            {"uint", "uint32", 4, 'u'},
                                            {"float", "float32", 4, 'f'},
                                            {"double", "float64", 8, 'f'}}};

class Ply {
 public:
  Ply(std::string_view content, const std::string& name)
      : content_(content), name_(name), text_(content, name) {}

  Mesh read() {
    read_header();
    place_ = text_.after_line();
    for (const Element& element : elements_)
      for (std::uint64_t i = 0; i < element.count; ++i) read_one(element);
    return std::move(mesh_);
  }

 private:
  struct Property {
    std::string name;
    const PlyType *count = nullptr, *type = nullptr;  // count is the type of a list's length
  };
  struct Element {
    std::string name;
    std::uint64_t count = 0;
    std::vector<Property> properties{};
  };

  void read_header() {
    bool told_format = false;
    while (text_.next_line()) {
      const std::string_view key = text_.word();
      if (key == "ply" || key == "comment" || key == "obj_info" || key.empty()) continue;
      if (key == "end_header" && told_format) return;
      if (key == "format") {
        read_format();
        told_format = true;
      } else if (key == "element") {
        const std::string element(text_.word());
        const std::string_view count = text_.word();
        elements_.push_back({element, text_.number<std::uint64_t>(count, "a number")});
        if (elements_.back().count > most_elements) text_.fail(count, "at most ten million");
      } else if (key == "property" && !elements_.empty()) {
        read_property();
      } else {
        text_.fail(key, "format, element, property, comment or end_header");
      }
    }
    text_.fail("", "end_header");
  }
  void read_format() {
    const std::string_view format = text_.word();
    binary_ = format != "ascii";
    big_endian_ = format == "binary_big_endian";
    if (binary_ && !big_endian_ && format != "binary_little_endian")
      text_.fail(format, "ascii, binary_little_endian or binary_big_endian");
  }
  void read_property() {
    Property p;
    std::string_view word = text_.word();
    if (word == "list") {
      p.count = type_of(text_.word());
      word = text_.word();
    }
    p.type = type_of(word);
    p.name = text_.word();
    elements_.back().properties.push_back(p);
  }
  const PlyType* type_of(std::string_view word) const {
    for (const PlyType& type : ply_types)
      if (word == type.name || word == type.other_name) return &type;
    text_.fail(word, "a type such as float or uchar");
  }

  void read_one(const Element& element) {
    if (!binary_ && !text_.next_line())
      text_.fail("", "more lines of element " + printable(element.name));
    Vec3 point;
    for (const Property& p : element.properties) {
      if (p.count) {
        read_list(p, element.name == "face");
        continue;
      }
      const double value = number(*p.type);
      if (p.name == "x") point.x = value;
      if (p.name == "y") point.y = value;
      if (p.name == "z") point.z = value;
    }
    if (element.name != "vertex") return;
    for (const double s : {point.x, point.y, point.z})
      if (!(std::abs(s) <= farthest)) fail(std::to_string(s), "a coordinate of at most 1e6");
    mesh_.points.push_back(point);
  }
  void read_list(const Property& p, bool of_face) {
    const double count = number(*p.count);
    if (!(count >= 0 && count <= 1e6)) fail(std::to_string(count), "the length of a list");
    const bool corners = of_face && (p.name == "vertex_indices" || p.name == "vertex_index");
    corners_.clear();
    for (double i = 0; i < count; ++i) {
      const double value = number(*p.type);
      if (!corners) continue;
      const auto points = static_cast<double>(mesh_.points.size());
      if (!(value >= 0 && value < points && value == std::floor(value)))
        fail(std::to_string(value),
             "a vertex index from 0 to " + std::to_string(mesh_.points.size()) + " less one");
      corners_.push_back(static_cast<std::uint32_t>(value));
    }
    add_polygon(mesh_, corners_);
  }

  double number(const PlyType& type) {
    if (!binary_) return text_.number<double>(text_.word(), "a number");
    if (content_.size() - place_ < type.bytes) fail("the end", "more numbers");
    std::array<char, 8> raw{};
    std::memcpy(raw.data(), content_.data() + place_, type.bytes);
    place_ += type.bytes;
    if (big_endian_ == (std::endian::native == std::endian::little))
      std::reverse(raw.data(), raw.data() + type.bytes);
    if (type.kind == 'f') return type.bytes == 4 ? as<float>(raw) : as<double>(raw);
    if (type.bytes == 1) return type.kind == 'i' ? as<std::int8_t>(raw) : as<std::uint8_t>(raw);
    if (type.bytes == 2) return type.kind == 'i' ? as<std::int16_t>(raw) : as<std::uint16_t>(raw);
    return type.kind == 'i' ? as<std::int32_t>(raw) : as<std::uint32_t>(raw);
  }
  template <class T>
  static double as(const std::array<char, 8>& raw) {
    T value;
    std::memcpy(&value, raw.data(), sizeof value);
    return static_cast<double>(value);
  }

  [[noreturn]] void fail(const std::string& found, const std::string& expected) const {
    if (!binary_) text_.fail(found, expected);
    throw Error(ExitCode::config, name_ + ": byte " + std::to_string(place_) + ": found " + found +
                                      "; expected " + expected);
  }

  std::string_view content_;
  const std::string& name_;
  Text text_;
  std::size_t place_ = 0;  // in the binary part
  bool binary_ = false, big_endian_ = false;
  std::vector<Element> elements_;
  std::vector<std::uint32_t> corners_;
  Mesh mesh_;
};

}  // namespace

Mesh read_mesh(const std::string& content, const std::string& name) {
  const bool ply = content.rfind("ply\n", 0) == 0 || content.rfind("ply\r\n", 0) == 0;
  Mesh mesh = ply ? Ply(content, name).read() : read_obj(content, name);
  check_size(mesh, name);
  return mesh;
}

const Mesh& mesh_of(const std::string& path) {
  static std::mutex mutex;
  static std::map<std::string, Mesh> known;
  const std::lock_guard lock(mutex);
  auto found = known.find(path);
  if (found == known.end())
    found = known.emplace(path, read_mesh(read_config_text(path), path)).first;
  return found->second;
}

}  // namespace echofuse::sim
