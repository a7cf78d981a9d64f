// SPDX-License-Identifier: MIT
#pragma once
#include <cstddef>
#include <string>

#include "acquire/record/h5.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

void write_matrix(record::H5File& file, const std::string& name, const Matrix& table);
// A table as write_matrix() left it. Either of its sides may be H5File::any.
Matrix read_matrix(const record::H5File& file, const std::string& name, std::size_t rows,
                   std::size_t cols);

// For load(): throws Error(failed) that names the object and what would be right.
void require_sound(const record::H5File& file, bool sound, const std::string& object,
                   const std::string& expected);

}  // namespace echofuse::recon
