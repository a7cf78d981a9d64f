// SPDX-License-Identifier: MIT
#include "sim/study/scene_parts.hpp"

#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <future>
#include <map>
#include <sstream>
#include <thread>

#include "drivers/program/console.hpp"
#include "drivers/program/new_file.hpp"
#include "drivers/program/printable.hpp"
#include "drivers/program/program.hpp"
#include "drivers/program/settings.hpp"

namespace echofuse::sim {
namespace {

using Rows = std::map<std::size_t, SceneRow>;

std::string head_of(const SceneParts& parts, const std::string& name) {
  std::istringstream settings(parts.settings);
  std::string out = "# study " + name + "\n# echofuse " + version() + "\n";
  for (std::string line; std::getline(settings, line);) out += "# " + line + "\n";
  return out;
}

// Parses one line; nothing if it is no row.
std::optional<std::pair<std::size_t, SceneRow>> parse(const std::string& line) {
  std::pair<std::size_t, SceneRow> out;
  const char* at = line.data();
  const char* const end = at + line.size();
  const auto scene = std::from_chars(at, end, out.first);
  if (scene.ec != std::errc{}) return std::nullopt;
  for (at = scene.ptr; at != end;) {
    double value = 0;
    if (*at != ',') return std::nullopt;
    const auto number = std::from_chars(at + 1, end, value);
    if (number.ec != std::errc{}) return std::nullopt;
    out.second.push_back(value), at = number.ptr;
  }
  return out;
}

void read_part(const std::string& path, const std::string& head, Rows& rows) {
  std::istringstream in(read_config_text(path)), wanted(head);
  std::string line, expected;
  while (std::getline(wanted, expected))
    if (!std::getline(in, line) || line != expected)
      refuse_part(ExitCode::config, path, line, expected);
  while (std::getline(in, line)) {
    auto row = parse(line);
    const bool fits = row && (rows.empty() || rows.begin()->second.size() == row->second.size());
    if (!fits)
      throw Error(ExitCode::failed, printable(path) +
                                        ": damaged: no row of numbers of a scene: \"" +
                                        printable(line, 40) + "\"");
    rows.insert(std::move(*row));
  }
}

void write_part(const std::string& path, const std::string& head, const Rows& rows) {
  NewFile file(path, NewFile::Staged{});
  std::ofstream out(file.path(), std::ios::binary);
  out << head;
  for (const auto& [scene, row] : rows) {
    out << scene;
    char number[32];
    for (const double value : row) {
      std::snprintf(number, sizeof number, ",%.17g", value);
      out << number;
    }
    out << '\n';
  }
  out.close();
  if (!out) throw Error(ExitCode::disk, printable(file.path()) + ": cannot be written");
  file.publish();
}

// Returns work(i) of these scenes i, in their order, computed on all processors.
std::vector<SceneRow> each_of(const std::string& title, const std::vector<std::size_t>& scenes,
                              bool quiet, const std::function<SceneRow(std::size_t)>& work) {
  std::vector<SceneRow> found(scenes.size());
  std::atomic<std::size_t> next{0}, done{0};
  const auto run = [&] {
    for (std::size_t i = next++; i < found.size() && !interrupted(); i = next++, ++done)
      found[i] = work(scenes[i]);
  };
  std::vector<std::future<void>> workers;
  for (unsigned t = 0; t < usable_cores(); ++t)
    workers.push_back(std::async(std::launch::async, run));
  Progress progress(title, found.size(), quiet);
  for (auto& worker : workers)
    while (worker.wait_for(std::chrono::milliseconds(200)) != std::future_status::ready)
      progress.update(done);
  for (auto& worker : workers) worker.get();
  if (interrupted()) throw Error(ExitCode::interrupted, "interrupted; nothing was written");
  return found;
}

}  // namespace

std::vector<SceneRow> rows_of_scenes(const SceneParts& parts, const std::string& name,
                                     const std::string& title, std::int64_t scenes, bool quiet,
                                     const std::function<SceneRow(std::size_t)>& work) {
  const auto count = static_cast<std::size_t>(scenes);
  const std::string head = head_of(parts, name);
  Rows known, own;
  if (!parts.folder.empty())
    for (const auto& path : part_files(parts.folder, name + "-", ".csv"))
      read_part(path, head, known);
  std::vector<bool> mine(count, true);
  if (parts.part) mine = parts.part->share(std::vector<double>(count, 1));
  std::vector<std::size_t> left;
  for (std::size_t i = 0; i < count; ++i)
    if (mine[i] && !known.contains(i)) left.push_back(i);
  const auto measured = each_of(title, left, quiet, work);
  for (std::size_t k = 0; k < left.size(); ++k) known[left[k]] = measured[k];
  std::vector<SceneRow> out;
  for (std::size_t i = 0; i < count; ++i)
    if (mine[i]) own[i] = known.at(i);
  if (parts.part) {
    write_part(parts.folder + "/" + name + "-" + parts.part->name() + ".csv", head, own);
    return {};
  }
  for (std::size_t i = 0; i < count; ++i) out.push_back(known.at(i));
  return out;
}

}  // namespace echofuse::sim
