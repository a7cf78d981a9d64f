// SPDX-License-Identifier: MIT
// Reading and writing of whole files, with errors that name them.
#pragma once
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon {

Bytes read_file(const std::string& path);                     // throws Error(failed)
std::string read_text(const std::string& path);               // throws Error(failed)
void write_file(const std::string& path, ByteView contents);  // like write_atomically()
void make_folder(const std::string& path);                    // throws Error(disk)

// Fields of a CSV line; quotes may hold commas.
std::vector<std::string> csv_fields(const std::string& line);

}  // namespace echofuse::recon
