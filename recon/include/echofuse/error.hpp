// SPDX-License-Identifier: MIT
/// @file
/// Exception that the library throws.
#pragma once
#include <cstdint>
#include <stdexcept>
#include <string>

#include "echofuse/version.hpp"

namespace echofuse {

/// Kind of an error.
enum class ErrorCode : std::uint8_t {
  usage = 1,     ///< an argument is not valid, or a run and a model do not fit together
  not_found,     ///< the file, or the record, does not exist
  other_format,  ///< the file is not a run or a model, or has a format of another version
  damaged,       ///< the file, or the record, is damaged
  in_use,        ///< another program is using the file; try again
  disk,          ///< the operating system cannot read the file
};

/// Thrown by all functions. The text has one line, which names the file and states the fault.
class Exception : public std::runtime_error {
 public:
  /// Creates an exception with this text.
  Exception(ErrorCode code, const std::string& text);
  /// Returns the kind of the error.
  [[nodiscard]] ErrorCode code() const noexcept { return code_; }

 private:
  ErrorCode code_;
};

}  // namespace echofuse
