// SPDX-License-Identifier: MIT
#include "recon/maps/written_maps.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "drivers/core/median.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/npy.hpp"
#include "drivers/util/printable.hpp"
#include "recon/data/copies.hpp"
#include "recon/data/files.hpp"
#include "recon/maps/png.hpp"

namespace echofuse::recon {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& path, const std::string& what) {
  throw Error(ExitCode::failed, printable(path) + ": " + what);
}

void require_grid(const std::string& path, std::size_t width, std::size_t height,
                  const record::MapGrid& grid) {
  if (width != grid.size || height != grid.size)
    refuse(path, format("maps have %zu x %zu pixels; expected %u x %u", width, height, grid.size,
                        grid.size));
}

// Converts NaN to 0. Throws Error(failed) if a value is not a possible depth in metres.
std::vector<float> depths(const std::string& path, std::int64_t index, std::vector<double> values) {
  std::vector<float> out(values.begin(), values.end());
  std::vector<float> there;
  for (float& z : out) {
    if (std::isnan(z)) z = 0;
    if (!(z >= -100 && z < 1e6))
      refuse(path, format("record %lld has an impossible depth: %g m",
                          static_cast<long long>(index), double{z}));
    if (z > 0) there.push_back(z);
  }
  if (there.empty()) return out;
  const float median_m = median(std::move(there));
  if (median_m > 200)
    refuse(path, format("the median depth of record %lld is %g m; expected metres, not "
                        "millimetres",
                        static_cast<long long>(index), double{median_m}));
  return out;
}

bool has_map(const std::string& status) {
  return std::ranges::any_of(std::array{"ok", "radar lost", "antennas lost"},
                             [&](const char* begin) { return status.starts_with(begin); });
}

// Calls visit(index, has_map) for each line of records.csv.
template <class Visit>
void read_table(const std::string& path, const Visit& visit) {
  std::istringstream text(read_text(path));
  std::string line;
  std::getline(text, line);
  const auto head = csv_fields(line);
  const auto column = [&](const char* name) {
    const auto at = std::ranges::find(head, name);
    if (at == head.end()) refuse(path, format("has no column \"%s\"", name));
    return static_cast<std::size_t>(at - head.begin());
  };
  const std::size_t index = column("record"), status = column("status");
  while (std::getline(text, line)) {
    const auto fields = csv_fields(line);
    if (fields == std::vector<std::string>{""}) continue;
    const bool whole = fields.size() > std::max(index, status) && !fields[status].empty();
    const std::string word = whole ? fields[index] : "";
    std::int64_t number = -1;
    const auto read = std::from_chars(word.data(), word.data() + word.size(), number);
    if (read.ec != std::errc{} || read.ptr != word.data() + word.size() || number < 0)
      refuse(path, format("\"%s\" is not a line with a record index and a status",
                          printable(line, 100).c_str()));
    visit(number, has_map(fields[status]));
  }
}

void read_array(const std::string& folder, const record::MapGrid& grid, WrittenMaps& out) {
  const std::string path = folder + "/maps.npy";
  NpyFile file(path);
  if (file.shape().size() != 3 || file.is_bool())
    refuse(path, "its shape is " + file.shape_text() + "; expected depths [n, N, N]");
  require_grid(path, file.shape()[2], file.shape()[1], grid);
  std::size_t row = 0;
  read_table(folder + "/records.csv", [&](std::int64_t index, bool has) {
    if (!has) return out.without.push_back(index);
    if (out.of_index.contains(index))
      refuse(path, format("record %lld has two maps", static_cast<long long>(index)));
    if (row++ < file.rows()) out.of_index[index] = depths(path, index, file.next_row());
  });
  if (row != file.rows())
    refuse(path,
           format("has %zu maps, but records.csv lists %zu records with a map", file.rows(), row));
}

void read_pictures(const std::string& folder, const record::MapGrid& grid, WrittenMaps& out) {
  const std::string camera_path = folder + "/camera.json";
  const auto camera = nlohmann::json::parse(read_text(camera_path), nullptr, false);
  const auto number = [&](const char* key, double otherwise) {
    const auto at = camera.is_object() ? camera.find(key) : camera.end();
    return camera.is_object() && at != camera.end() && at->is_number() ? at->get<double>()
                                                                       : otherwise;
  };
  const double width = number("width", 0), fx = number("fx", 0),
               scale = number("depth_scale", 1000);
  if (!(width > 0 && fx > 0 && scale > 0))
    refuse(camera_path, "expected positive width, fx and depth_scale");
  constexpr double widest = 1e6;
  require_grid(camera_path, static_cast<std::size_t>(std::min(width, widest)), grid.size, grid);
  if (std::abs(fx * grid.step() - 1) > 1.0 / grid.size)
    refuse(camera_path,
           format("fx is %g; expected %g, for the field of view of the run", fx, 1 / grid.step()));
  // Paths of the pictures by record index. Pictures in millimetres take precedence.
  std::map<std::int64_t, std::string> pictures;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    std::int64_t index = 0;
    const auto read = std::from_chars(name.data(), name.data() + name.size(), index);
    const std::string rest = name.substr(static_cast<std::size_t>(read.ptr - name.data()));
    if (read.ec != std::errc{} || (rest != ".png" && rest != "_mm.png")) continue;
    if (rest == "_mm.png" || !pictures.contains(index)) pictures[index] = entry.path().string();
  }
  for (const auto& [index, path] : pictures) {
    const auto steps = decode_png16(read_file(path), grid.size, grid.size);
    if (steps.empty())
      refuse(path, format("expected a 16-bit grey PNG of %u x %u", grid.size, grid.size));
    std::vector<double> metres(steps.begin(), steps.end());
    for (double& z : metres) z /= scale;
    out.of_index[index] = depths(path, index, std::move(metres));
  }
}

void read_run(const std::string& path, WrittenMaps& out) {
  std::istringstream text(read_text(path));
  std::getline(text, out.uuid);
  std::getline(text, out.path);
  std::string line;
  while (std::getline(text, line)) {
    if (!line.starts_with(trained_on_records)) continue;
    std::istringstream numbers(line.substr(std::string(trained_on_records).size()));
    for (std::string word; std::getline(numbers, word, ',');) {
      std::int64_t index = 0;
      const auto read = std::from_chars(word.data(), word.data() + word.size(), index);
      if (read.ec == std::errc{}) out.trained_on.insert(index);
    }
  }
}

}  // namespace

WrittenMaps read_written_maps(const std::string& folder, const record::MapGrid& grid) {
  WrittenMaps out;
  out.name = fs::path(folder).lexically_normal().filename().string();
  if (out.name.empty()) out.name = fs::path(folder).parent_path().filename().string();
  if (fs::exists(folder + "/maps.npy"))
    read_array(folder, grid, out);
  else if (fs::exists(folder + "/camera.json"))
    read_pictures(folder, grid, out);
  else
    refuse(folder, "contains neither maps.npy with records.csv nor PNGs with camera.json");
  if (out.of_index.empty()) refuse(folder, "contains no map");
  if (fs::exists(folder + "/run.txt")) read_run(folder + "/run.txt", out);
  return out;
}

std::vector<std::string> left_out_of_maps(const std::vector<WrittenMaps>& folders,
                                          const Dataset& data, bool all) {
  const Source& run = data.sources.front();
  for (const WrittenMaps& maps : folders)
    if (!maps.uuid.empty() && maps.uuid != run.uuid)
      refuse(maps.name, "contains maps of another run, " + printable(maps.path) +
                            "; expected maps of " + printable(run.path));
  std::set<std::int64_t> known;
  for (const RecordInfo& record : data.records) known.insert(record.index);
  for (const DamagedRecord& record : data.damaged) known.insert(record.index);
  for (const WrittenMaps& maps : folders)
    for (const auto& [index, map] : maps.of_index)
      if (!known.contains(index))
        refuse(maps.name, format("contains a map of record %lld; %s has no such record",
                                 static_cast<long long>(index), printable(run.path).c_str()));
  Copies copies;
  std::vector<std::string> out(data.size());
  for (std::size_t row = 0; row < data.size(); ++row) {
    const std::int64_t index = data.records[row].index;
    out[row] = data.has(row, Sensor::depth) ? doubt_of(data, row, Inputs::fused) : "camera missing";
    if (!out[row].empty()) continue;
    for (const WrittenMaps& maps : folders) {
      if (!all && maps.trained_on.contains(index)) out[row] = trained_on_record;
    }
    if (out[row].empty() && copies.first(data.records[row].content, row) != row)
      out[row] = duplicate_in_run;
  }
  return out;
}

std::size_t count_maps(const WrittenMaps& maps, const Dataset& data, const Rows& rows) {
  const auto answered = static_cast<std::size_t>(std::ranges::count_if(
      rows, [&](std::size_t row) { return maps.of_index.contains(data.records[row].index); }));
  if (answered == 0)
    refuse(maps.name, format("has %zu maps, but none for the %zu scored records",
                             maps.of_index.size(), rows.size()));
  return answered;
}

Matrix maps_of(const WrittenMaps& maps, const Dataset& data, const Rows& rows,
               const std::vector<float>& empty) {
  Matrix out(0, data.depth().cols);
  for (const std::size_t row : rows) {
    const auto own = maps.of_index.find(data.records[row].index);
    out.add_row(own == maps.of_index.end() ? empty : own->second);
  }
  return out;
}

NpyWriter::NpyWriter(const std::string& path, std::vector<std::size_t> row_shape)
    : path_(path),
      file_(path),
      out_(file_.path(), std::ios::binary | std::ios::in | std::ios::out),
      row_shape_(std::move(row_shape)) {
  out_ << npy_header("<f4", 0, row_shape_);
  flush();
}

void NpyWriter::append(std::span<const float> row) {
  waiting_.insert(waiting_.end(), row.begin(), row.end());
  ++rows_;
  if (waiting_.size() >= std::size_t{1} << 16) flush();
}

void NpyWriter::flush() {
  out_.write(reinterpret_cast<const char*>(waiting_.data()),
             static_cast<std::streamsize>(waiting_.size() * sizeof(float)));
  waiting_.clear();
  if (!out_) throw Error(ExitCode::disk, path_ + ": cannot write: " + std::strerror(errno));
}

void NpyWriter::close() {
  flush();
  out_.seekp(0);
  out_ << npy_header("<f4", rows_, row_shape_);
  out_.close();
  if (!out_) throw Error(ExitCode::disk, path_ + ": cannot write: " + std::strerror(errno));
  file_.publish();
}

}  // namespace echofuse::recon
