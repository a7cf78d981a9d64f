// SPDX-License-Identifier: MIT
// File systems on a network: SQLite's WAL needs memory that all who have the file open share, and
// locks of another machine may not be seen here.
#pragma once
#include <cstdint>
#include <istream>
#include <string>

namespace echofuse::record {

// "NFS" and the like, by the type that statfs(2) gives; empty for any other.
std::string network_of_type(std::uint64_t type);
// Name of the network file system that is mounted as a device ("0:52") by the lines of
// /proc/self/mountinfo: FUSE and virtiofs have one type in statfs(2), local or not.
std::string network_of_mount(std::istream& mountinfo, const std::string& device);
// Name of the file's network file system, or its future folder's; empty if local or unknown.
std::string network_of(const std::string& path);

// Throws Error(failed) if a run on such a network is being written, or was not closed. One
// machine's writes are not seen whole on another.
void require_closed(const std::string& path, const std::string& network);

}  // namespace echofuse::record
