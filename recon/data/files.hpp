// SPDX-License-Identifier: MIT
// Reads and writes whole files. Errors contain the file name.
#pragma once
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon {

Bytes read_file(const std::string& path);  // throws Error(failed) if the file cannot be read
// Returns the text without its byte order mark and carriage returns. Throws Error(failed) if the
// file cannot be read.
std::string read_text(const std::string& path);
// Replaces the file atomically (see write_atomically()).
void write_file(const std::string& path, ByteView contents);
void make_folder(const std::string& path);  // throws Error(disk) if the folder cannot be created

// Splits a CSV line into fields. A quoted field may contain commas.
std::vector<std::string> csv_fields(const std::string& line);

}  // namespace echofuse::recon
