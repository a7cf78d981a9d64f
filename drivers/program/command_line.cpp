// SPDX-License-Identifier: MIT
#include "drivers/program/command_line.hpp"

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "drivers/program/settings.hpp"

namespace echofuse {
namespace {

// Of this command and those above it.
const CLI::Option* option_named(const CLI::App* app, const std::string& name) {
  for (; app != nullptr; app = app->get_parent())
    if (const CLI::Option* option = app->get_option_no_throw(name)) return option;
  return nullptr;
}

void add_options(const CLI::App* app, std::vector<std::string>& out) {
  for (const CLI::Option* option : app->get_options())
    for (const std::string& name : option->get_lnames()) out.push_back("--" + name);
  for (const CLI::App* sub : app->get_subcommands({}))
    if (sub->get_name().empty()) add_options(sub, out);  // a group of options
}

std::vector<std::string> options_of(const CLI::App* app) {
  std::vector<std::string> out;
  for (; app != nullptr; app = app->get_parent()) add_options(app, out);
  return out;
}

std::vector<std::string> commands_of(const CLI::App* app) {
  std::vector<std::string> out;
  for (const CLI::App* sub : app->get_subcommands({}))
    if (!sub->get_name().empty()) out.push_back(sub->get_name());  // a group of options has none
  return out;
}

// Refuses the first word that is no command where one is needed, and the first unknown option.
void check_names(CLI::App& app, const std::vector<std::string>& words) {
  CLI::App* command = &app;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    if (word == "--") return;
    if (word.starts_with("--")) {
      const auto equals = word.find('=');
      const std::string name = word.substr(0, equals);
      const CLI::Option* option = option_named(command, name);
      if (option == nullptr)
        throw CLI::ExtrasError(
            name + ": no such option; the nearest is " + nearest(options_of(command), name),
            CLI::ExitCodes::ExtrasError);
      if (equals == word.npos && option->get_expected_max() > 0) ++i;
      continue;
    }
    if (word.starts_with("-")) {
      const CLI::Option* option = option_named(command, word.substr(0, 2));
      if (option != nullptr && word.size() == 2 && option->get_expected_max() > 0) ++i;
      continue;
    }
    const auto commands = commands_of(command);
    if (commands.empty()) continue;
    if (std::ranges::find(commands, word) == commands.end())
      throw CLI::ExtrasError(word + ": no such command; the nearest is " + nearest(commands, word),
                             CLI::ExitCodes::ExtrasError);
    command = command->get_subcommand(word);
  }
}

// CLI11 writes the ends of a range of numbers with all their digits.
std::string readable(std::string text) {
  const std::string endless = " not in range 0.000000 to 17976931348623157";
  if (const auto at = text.find(endless); at != text.npos)
    text = text.substr(0, at) + ": expected a positive number";
  const bool range = text.find(" not in range ") != text.npos;
  for (auto at = text.find(".000000"); range && at != text.npos; at = text.find(".000000"))
    text.erase(at, 7);
  const std::string cannot = "Could not convert: ";
  if (text.starts_with(cannot)) text = text.substr(cannot.size()) + ": expected a number";
  return text;
}

// --help without the words of the library's validators: "(0.05 to 3600)".
class Readable final : public CLI::Formatter {
  std::string make_option_name(const CLI::Option* option, bool positional) const override {
    std::string name = Formatter::make_option_name(option, positional);
    if (const auto at = name.find("{false}"); at != name.npos) name.erase(at, 7);
    return name;
  }
  // Of ":INT in [1 - 9]" or ":(INT in [0 - 0]) OR (INT in [1 - 9])" it makes " (1 to 9)" or " (0,
  // or 1 to 9)".
  std::string make_option_opts(const CLI::Option* option) const override {
    const std::string text = Formatter::make_option_opts(option);
    const std::string above = ":POSITIVE", not_below = ":NONNEGATIVE", in = " in [",
                      zero = " in [0 - 0]) OR (";
    if (const auto at = text.find(above); at != text.npos)
      return std::string(text).replace(at, above.size(), " (above 0)");
    if (const auto at = text.find(not_below); at != text.npos)
      return std::string(text).replace(at, not_below.size(), " (at least 0)");
    const auto first = text.find(in);
    if (first == text.npos) return text;
    const bool or_zero = text.compare(first, zero.size(), zero) == 0;
    const auto low = text.find(in, first + (or_zero ? zero.size() : 0)) + in.size();
    const auto dash = text.find(" - ", low), high = text.find(']', low);
    std::string out = text.substr(0, text.rfind(':', first));
    out += or_zero ? " (0, or " : " (";
    out += text.substr(low, dash - low) + " to " + text.substr(dash + 3, high - dash - 3) + ")";
    return out + text.substr(high + (or_zero ? 2 : 1));
  }
};

void format_all(CLI::App& app, const std::shared_ptr<CLI::FormatterBase>& formatter) {
  app.formatter(formatter);
  for (CLI::App* sub : app.get_subcommands({})) format_all(*sub, formatter);
}

}  // namespace

void parse_command_line(CLI::App& app, int argc, const char* const* argv) {
  format_all(app, std::make_shared<Readable>());
  std::vector<std::string> words(argv + std::min(argc, 1), argv + argc);
  if (!words.empty() && words[0] == "help") {
    words.erase(words.begin());
    words.emplace_back("--help");
  }
  check_names(app, words);
  std::vector<std::string> reversed(words.rbegin(), words.rend());
  try {
    app.name(app.get_name().empty() ? argv[0] : app.get_name());
    app.parse(reversed);
  } catch (const CLI::Success&) {
    throw;
  } catch (const CLI::ParseError& e) {
    const std::string text = readable(e.what());
    if (text == e.what()) throw;
    throw CLI::ExtrasError(text, CLI::ExitCodes::ValidationError);
  }
}

}  // namespace echofuse
