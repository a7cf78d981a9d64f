// SPDX-License-Identifier: MIT
// Error with a cause that the public interface distinguishes (recon/include/echofuse/error.hpp).
#pragma once
#include <cerrno>
#include <cstdint>
#include <string>

#include "drivers/util/exit_code.hpp"

namespace echofuse {

// unreadable: the operating system does not allow or cannot complete the reading of a file.
enum class Cause : std::uint8_t { not_found, other_format, in_use, unreadable };

inline Cause cause_of(int error) {  // `error` is a value of errno
  return error == ENOENT || error == ENOTDIR ? Cause::not_found : Cause::unreadable;
}

class CausedError : public Error {
 public:
  CausedError(Cause cause, const std::string& text, ExitCode code = ExitCode::failed)
      : Error(code, text), cause_(cause) {}
  Cause cause() const { return cause_; }

 private:
  Cause cause_;
};

}  // namespace echofuse
