// SPDX-License-Identifier: MIT
#pragma once
#include <memory>

namespace spdlog {
class formatter;
}

namespace echofuse::acquire {

// Of the log on stderr: on a terminal a message first clears the status line; the journal keeps the
// time by itself. Nothing in a message moves the cursor, whoever sent the text.
std::unique_ptr<spdlog::formatter> log_format();

}  // namespace echofuse::acquire
