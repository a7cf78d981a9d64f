// SPDX-License-Identifier: MIT
// Network file systems. SQLite's WAL needs shared memory between all processes that open the file,
// and locks of another machine may not be visible.
#pragma once
#include <cstdint>
#include <istream>
#include <string>

namespace echofuse::record {

// Returns "NFS" etc. for a type from statfs(2); empty for other types.
std::string network_of_type(std::uint64_t type);
// Returns the network file system mounted as this device ("0:52"), according to
// /proc/self/mountinfo. FUSE and virtiofs have the same type in statfs(2) whether local or remote.
std::string network_of_mount(std::istream& mountinfo, const std::string& device);
// Returns the network file system of the file, or of its future folder; empty if local or unknown.
std::string network_of(const std::string& path);

// Throws Error(failed) if a run on such a file system is being written, or was not closed: another
// machine's writes are not visible completely.
void require_closed(const std::string& path, const std::string& network);

}  // namespace echofuse::record
