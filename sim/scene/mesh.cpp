// SPDX-License-Identifier: MIT
#include "sim/scene/mesh.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <memory>
#include <mutex>
#include <string_view>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::sim {
namespace {

constexpr std::size_t max_triangles = 1'000'000;
constexpr double farthest = 1e6;  // largest allowed absolute coordinate, in units of the mesh

// Splits a string into words, line by line. Skips a byte order mark and comments. A line that ends
// with a backslash continues on the next line.
class WordReader {
 public:
  WordReader(std::string_view text, const std::string& name) : text_(text), name_(name) {
    if (text_.starts_with("\xef\xbb\xbf")) text_.remove_prefix(3);
  }

  bool next_line() {
    if (at_ >= text_.size()) return false;
    line_text_.clear();
    for (bool goes_on = true; goes_on && at_ < text_.size(); ++line_) {
      const std::size_t end = std::min(text_.find('\n', at_), text_.size());
      line_text_ += text_.substr(at_, end - at_);
      at_ = end + 1;
      while (line_text_.ends_with('\r')) line_text_.pop_back();
      // A comment may end with a Windows path such as C:\meshes\, which continues nothing.
      goes_on = line_text_.ends_with('\\') && line_text_.find('#') == line_text_.npos;
      if (goes_on) line_text_.back() = ' ';
    }
    rest_ = std::string_view(line_text_).substr(0, line_text_.find('#'));
    return true;
  }
  // Returns the next word of the line; empty at the end of the line.
  std::string_view word() {
    const std::size_t begin = std::min(rest_.find_first_not_of(" \t\r"), rest_.size());
    const std::size_t end = std::min(rest_.find_first_of(" \t\r", begin), rest_.size());
    const std::string_view found = rest_.substr(begin, end - begin);
    rest_.remove_prefix(end);
    return found;
  }

  template <class Number>
  Number number(std::string_view word, const char* expected) const {
    Number value{};
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size()) fail(word, expected);
    return value;
  }
  double coordinate(std::string_view word) const {
    const auto value = number<double>(word, "a coordinate");
    if (!(std::abs(value) <= farthest)) fail(word, "a coordinate from -1e6 to 1e6");
    return value;
  }
  [[noreturn]] void fail(std::string_view found, const std::string& expected) const {
    throw Error(ExitCode::config, name_ + ":" + std::to_string(line_) + ": found \"" +
                                      printable(std::string(found.substr(0, 40))) +
                                      "\"; expected " + expected);
  }

 private:
  std::string_view text_, rest_;
  std::string line_text_;
  const std::string& name_;
  std::size_t at_ = 0, line_ = 0;
};

// Returns true if a corner of the polygon points inwards, or if the polygon crosses itself.
bool is_concave(const Mesh& mesh, const std::vector<std::uint32_t>& corners) {
  const auto point = [&](std::size_t i) { return mesh.points[corners[i % corners.size()]]; };
  Vec3 normal{};
  for (std::size_t i = 2; i < corners.size(); ++i)
    normal = normal + cross(point(i - 1) - point(0), point(i) - point(0));
  constexpr double rounding = 1e-6;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Vec3 turn = cross(point(i + 1) - point(i), point(i + 2) - point(i + 1));
    const bool no_area = dot(normal, normal) == 0 && dot(turn, turn) > 0;
    if (no_area || dot(turn, normal) < -rounding * dot(normal, normal)) return true;
  }
  return false;
}

// Adds a polygon as a triangle fan. Omits triangles of zero area.
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
    throw Error(ExitCode::config,
                name + ": contains no triangles; expected a Wavefront OBJ file with faces");
  if (mesh.triangles.size() > max_triangles)
    throw Error(ExitCode::config, name + ": " + std::to_string(mesh.triangles.size()) +
                                      " triangles; expected at most one million");
}

// Returns the zero-based index of a vertex. Indices in the file count from 1 or, if negative,
// backwards from the last vertex.
std::uint32_t obj_corner(const WordReader& text, std::string_view word, std::size_t points) {
  const auto index = text.number<std::int64_t>(word.substr(0, word.find('/')), "a vertex index");
  const auto count = static_cast<std::int64_t>(points);
  if (index == 0 || index > count || index < -count)
    text.fail(word, "a vertex index from 1 to " + std::to_string(count));
  return static_cast<std::uint32_t>(index > 0 ? index - 1 : count + index);
}

Mesh read_obj(std::string_view content, const std::string& name) {
  Mesh mesh;
  WordReader text(content, name);
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
      if (corners.size() < 3) text.fail(key, "a face with at least three vertices");
      if (is_concave(mesh, corners)) text.fail(key, "a convex face; split the face into triangles");
      add_polygon(mesh, corners);
    }
  }
  return mesh;
}

}  // namespace

Mesh read_mesh(const std::string& content, const std::string& name) {
  Mesh mesh = read_obj(content, name);
  check_size(mesh, name);
  return mesh;
}

Vec3 size_of(const Mesh& mesh) {
  Vec3 low{INFINITY, INFINITY, INFINITY}, high = -1 * low;
  for (const auto& corners : mesh.triangles)
    for (const auto corner : corners) {
      const Vec3 p = mesh.points[corner];
      low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
  return high - low;
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
