// SPDX-License-Identifier: MIT
#include "recon/output/map_parts.hpp"

#include <cstdio>
#include <filesystem>

#include "drivers/core/atomic_write.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/printable.hpp"
#include "drivers/core/program.hpp"
#include "recon/files/files.hpp"

namespace echofuse::recon {
namespace {

namespace fs = std::filesystem;
constexpr const char* what_file = "/part.txt";

std::string unfinished(const std::string& folder, const JobPart& part) {
  return folder + "/." + part.name() + "." + machine_name() + ".unfinished";
}

}  // namespace

MapParts::MapParts(std::string folder, const std::function<std::string()>& what)
    : folder_(std::move(folder)), parts_(part_files(folder_, "", "")) {
  const std::string wanted = parts_.empty() ? "" : what();
  for (const auto& part : parts_)
    if (!fs::exists(part + what_file) || read_text(part + what_file) != wanted)
      throw Error(ExitCode::usage, printable(part) +
                                       ": holds maps of another run, model or options; remove it, "
                                       "or give another --out");
}

bool MapParts::take(const std::string& name) const {
  for (const auto& part : parts_)
    if (std::rename((part + "/" + name).c_str(), (folder_ + "/" + name).c_str()) == 0) return true;
  return false;
}

void MapParts::remove() const {
  std::error_code ignored;
  for (const auto& part : parts_) fs::remove_all(part, ignored);
}

std::string begin_map_part(const std::string& folder, const JobPart& part,
                           const std::string& what) {
  const std::string out = unfinished(folder, part);
  std::error_code ignored;
  fs::remove_all(out, ignored);
  make_folder(out);
  write_atomically(out + what_file, what);
  return out;
}

void end_map_part(const std::string& folder, const JobPart& part) {
  const std::string place = folder + "/" + part.name();
  std::error_code error;
  fs::remove_all(place, error);
  fs::rename(unfinished(folder, part), place, error);
  if (error) throw Error(ExitCode::disk, printable(place) + ": " + error.message());
}

}  // namespace echofuse::recon
