// SPDX-License-Identifier: MIT
// Files that are replaced as a whole: what stands at a path is the old file or the new one. Who may
// read them.
#pragma once
#include <functional>
#include <string>
#include <string_view>

namespace echofuse {

// Has `write` make the file PATH.part and renames it to PATH. If `write` throws, PATH is as before.
// Throws Error(disk) if it cannot be renamed.
void write_atomically(const std::string& path,
                      const std::function<void(const std::string& part)>& write);
// The same with this text; throws Error(disk) if it cannot be written.
void write_atomically(const std::string& path, std::string_view text);

// Adds the permission to read for the file's group, whatever the umask says: a measuring PC has
// several users. Does nothing to a file of others.
void let_group_read(int file);

}  // namespace echofuse
