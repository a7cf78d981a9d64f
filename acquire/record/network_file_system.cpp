// SPDX-License-Identifier: MIT
#include "acquire/record/network_file_system.hpp"

#include <linux/magic.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::record {

// The types written as numbers are not defined in linux/magic.h. The numbers are from statfs(2) and
// from the headers of the file systems.
std::string network_of_type(std::uint64_t type) {
  constexpr std::pair<std::uint64_t, const char*> known[] = {
      {NFS_SUPER_MAGIC, "NFS"},   {SMB_SUPER_MAGIC, "SMB"}, {CIFS_SUPER_MAGIC, "SMB"},
      {SMB2_SUPER_MAGIC, "SMB"},  {AFS_SUPER_MAGIC, "AFS"}, {AFS_FS_MAGIC, "AFS"},
      {CEPH_SUPER_MAGIC, "Ceph"}, {V9FS_MAGIC, "9p"},       {0x786f4256, "vboxsf"},
      {0x0bd00bd0, "Lustre"},     {0x47504653, "GPFS"},     {0x19830326, "BeeGFS"},
      {0xaad7aaea, "Panasas"}};
  for (const auto& [number, name] : known)
    if (type == number) return name;
  return {};
}

std::string network_of_mount(std::istream& mountinfo, const std::string& device) {
  constexpr std::array network_types = {
      "virtiofs",       "fuse.sshfs", "fuse.rclone", "fuse.s3fs",    "fuse.gvfsd-fuse",
      "fuse.glusterfs", "fuse.ceph",  "fuse.davfs",  "fuse.juicefs", "fuse.vmhgfs-fuse"};
  for (std::string line; std::getline(mountinfo, line);) {
    std::istringstream words(line);
    std::string id, parent, of_line;
    words >> id >> parent >> of_line;
    const auto end = line.find(" - ");
    if (of_line != device || end == std::string::npos) continue;
    const std::string type = line.substr(end + 3, line.find(' ', end + 3) - end - 3);
    const bool on_network = std::ranges::find(network_types, type) != network_types.end();
    return on_network ? type.substr(type.starts_with("fuse.") ? 5 : 0) : "";
  }
  return {};
}

std::string network_of(const std::string& path) {
  struct statfs found {};
  std::string at = path;
  if (::statfs(at.c_str(), &found) != 0) {
    at = std::filesystem::path(path).parent_path().string();
    if (::statfs(at.empty() ? "." : at.c_str(), &found) != 0) return {};
  }
  const auto type = static_cast<std::uint32_t>(found.f_type);
  struct stat status {};
  if (type != FUSE_SUPER_MAGIC || ::stat(at.empty() ? "." : at.c_str(), &status) != 0)
    return network_of_type(type);
  std::ifstream mountinfo("/proc/self/mountinfo");
  return network_of_mount(
      mountinfo, std::to_string(major(status.st_dev)) + ":" + std::to_string(minor(status.st_dev)));
}

void require_closed(const std::string& path, const std::string& network) {
  if (::access((path + "-wal").c_str(), F_OK) != 0) return;
  const std::string shown = printable(path);
  throw Error(ExitCode::failed,
              shown + ": is on a network file system (" + network + ") and is being written, or " +
                  "was not closed; its last records are in " + shown +
                  "-wal; read it after it is closed, or copy both files to a local disk");
}

}  // namespace echofuse::record
