// SPDX-License-Identifier: MIT
#pragma once
#include <memory>

namespace spdlog {
class formatter;
}

namespace echofuse::acquire {

// Formatter of the log on stderr: erases the status line on a terminal, omits the time under
// systemd. Escapes control characters, so that no text moves the cursor.
std::unique_ptr<spdlog::formatter> log_format();

}  // namespace echofuse::acquire
