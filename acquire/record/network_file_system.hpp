// SPDX-License-Identifier: MIT
// Detection of network file systems. SQLite's WAL needs memory shared by all processes that open
// the file, and locks of another machine may not be visible.
#pragma once
#include <cstdint>
#include <istream>
#include <string>

namespace echofuse::record {

// Returns the name of the network file system, e.g. "NFS", for a type from statfs(2); empty for
// other types.
std::string network_of_type(std::uint64_t type);
// Returns the network file system that /proc/self/mountinfo lists for `device`, e.g. "0:52". The
// type from statfs(2) is not sufficient for FUSE and virtiofs, because it is the same for local and
// remote mounts.
std::string network_of_mount(std::istream& mountinfo, const std::string& device);
// Returns the network file system on which a file is stored; if the file does not exist, that of
// its folder. Returns an empty string if the file system is local or unknown.
std::string network_of(const std::string& path);

// Throws Error(failed) if the run is being written or was not closed, because writes by another
// machine may be only partly visible on this network file system.
void require_closed(const std::string& path, const std::string& network);

}  // namespace echofuse::record
