// SPDX-License-Identifier: MIT
#include <spdlog/pattern_formatter.h>
#include <unistd.h>

#include <ctime>

#include "acquire/commands/commands.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

// Pattern flag %N: syslog priority of the message for the journal, e.g. "<4>" for a warning.
class Priority final : public spdlog::custom_flag_formatter {
  void format(const spdlog::details::log_msg& message, const std::tm&,
              spdlog::memory_buf_t& out) override {
    // Syslog priorities of the levels from trace to critical, see sd-daemon(3).
    constexpr char priorities[] = {'7', '7', '6', '4', '3', '2'};
    out.push_back('<');
    out.push_back(priorities[static_cast<std::size_t>(message.level)]);
    out.push_back('>');
  }
  std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<Priority>();
  }
};

// Pattern flag %Q: the message, with escaped control characters.
class PrintableMessage final : public spdlog::custom_flag_formatter {
  void format(const spdlog::details::log_msg& message, const std::tm&,
              spdlog::memory_buf_t& out) override {
    const std::string text = printable_lines({message.payload.data(), message.payload.size()});
    out.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<PrintableMessage>();
  }
};

}  // namespace

std::unique_ptr<spdlog::formatter> log_format() {
  const char* pattern = stderr_is_journal()     ? "%N%Q"
                        : isatty(STDERR_FILENO) ? "\r\033[K%H:%M:%SZ %^%l%$ %Q"
                                                : "%Y-%m-%dT%H:%M:%S.%eZ %l %Q";
  auto format = std::make_unique<spdlog::pattern_formatter>(spdlog::pattern_time_type::utc);
  format->add_flag<Priority>('N').add_flag<PrintableMessage>('Q').set_pattern(pattern);
  return format;
}

}  // namespace echofuse::acquire
