// SPDX-License-Identifier: MIT
#include "acquire/record/network.hpp"

#include <linux/magic.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <filesystem>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {

// The last five have no name in linux/magic.h: statfs(2), and the projects' own headers.
std::string network_of_type(std::uint64_t type) {
  switch (type) {
    case NFS_SUPER_MAGIC:
      return "NFS";
    case SMB_SUPER_MAGIC:
    case CIFS_SUPER_MAGIC:
    case SMB2_SUPER_MAGIC:
      return "SMB";
    case AFS_SUPER_MAGIC:
    case AFS_FS_MAGIC:
      return "AFS";
    case CEPH_SUPER_MAGIC:
      return "Ceph";
    case 0x0bd00bd0:
      return "Lustre";
    case 0x47504653:
      return "GPFS";
    case 0x19830326:
      return "BeeGFS";
    case 0xaad7aaea:
      return "Panasas";
    default:
      return {};
  }
}

std::string network_of(const std::string& path) {
  struct statfs found {};
  std::string at = path;
  if (::statfs(at.c_str(), &found) != 0) {
    at = std::filesystem::path(path).parent_path().string();
    if (::statfs(at.empty() ? "." : at.c_str(), &found) != 0) return {};
  }
  return network_of_type(static_cast<std::uint32_t>(found.f_type));
}

void require_closed(const std::string& path, const std::string& network) {
  if (::access((path + "-wal").c_str(), F_OK) != 0) return;
  const std::string shown = printable(path);
  throw Error(ExitCode::failed,
              shown + ": is on a network file system (" + network + ") and is being written, or " +
                  "was not closed: its last records are in " + shown +
                  "-wal; read it when it is closed, or copy both to a local disk");
}

}  // namespace echofuse::record
