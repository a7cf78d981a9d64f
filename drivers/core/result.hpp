// SPDX-License-Identifier: MIT
// Why a device or the OS failed at run time.
#pragma once
#include <string>
#include <system_error>

namespace echofuse {

struct Failure {
  std::error_code code;
  std::string what;  // what was being done, with the address or file

  std::string text() const { return what + ": " + code.message(); }
};

}  // namespace echofuse
