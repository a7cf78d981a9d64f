// SPDX-License-Identifier: MIT
// Whole files, with errors that name them.
#pragma once
#include <string>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon {

Bytes read_file(const std::string& path);                           // throws Error(failed)
void write_file(const std::string& path, ByteView contents);        // throws Error(disk)
void write_text(const std::string& path, const std::string& text);  // throws Error(disk)
void make_folder(const std::string& path);                          // throws Error(disk)

}  // namespace echofuse::recon
