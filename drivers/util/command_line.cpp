// SPDX-License-Identifier: MIT
#include "drivers/util/command_line.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <regex>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "drivers/util/console.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse {
namespace {

// Returns the option with this name from the command or one of its parents, or nullptr.
const CLI::Option* option_named(const CLI::App* app, const std::string& name) {
  for (; app != nullptr; app = app->get_parent())
    if (const CLI::Option* option = app->get_option_no_throw(name)) return option;
  return nullptr;
}

std::vector<std::string> options_of(const CLI::App* app) {
  std::vector<std::string> out;
  for (; app != nullptr; app = app->get_parent())
    for (const CLI::Option* option : app->get_options())
      for (const std::string& name : option->get_lnames()) out.push_back(name);
  return out;
}

std::vector<std::string> commands_of(const CLI::App* app) {
  std::vector<std::string> out;
  for (const CLI::App* sub : app->get_subcommands({})) out.push_back(sub->get_name());
  return out;
}

[[noreturn]] void refuse_name(const std::string& name, const std::string& what,
                              const std::vector<std::string>& known, const std::string& dashes) {
  const std::string like = nearest(known, name);
  throw CLI::ExtrasError(
      dashes + name + ": no such " + what +
          (like.empty() ? "; --help lists them" : "; the most similar name is " + dashes + like),
      CLI::ExitCodes::ExtrasError);
}

// Throws CLI::ExtrasError for the first unknown command or option.
void check_names(CLI::App& app, const std::vector<std::string>& words) {
  CLI::App* command = &app;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    if (word == "--") return;
    if (word.starts_with("--")) {
      const auto equals = word.find('=');
      const std::string name = word.substr(0, equals);
      const CLI::Option* option = option_named(command, name);
      if (option == nullptr) refuse_name(name.substr(2), "option", options_of(command), "--");
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
      refuse_name(word, "command", commands, "");
    command = command->get_subcommand(word);
  }
}

// Rewrites CLI11's messages, because they print the limits of a range with all digits.
std::string readable(std::string text) {
  // CLI11 2.1 writes "A to B", CLI11 2.4 writes "[A - B]".
  text = std::regex_replace(text, std::regex(R"(not in range \[(\S+) - (\S+)\])"),
                            "not in range $1 to $2");
  const auto at = text.find(" not in range ");
  const std::string limits = text.substr(std::min(at, text.size()));
  if (limits.find(" 17976931348623157") != limits.npos || limits.ends_with(" 1.79769e+308"))
    return text.substr(0, at) + ": expected a positive number";
  if (at != text.npos)
    text = std::regex_replace(text, std::regex(R"((\.\d*[1-9])0+\b|\.0+\b)"), "$1");
  // CLI11 also reports a value that is not a number as out of range.
  text = std::regex_replace(
      text, std::regex(R"(Value (-?[\d.]+)([A-Za-z]+) not in range (\S+) to (\S+)$)"),
      "$1$2: expected a number from $3 to $4, without a unit");
  text = std::regex_replace(text, std::regex(" excludes "), " cannot be combined with ");
  return std::regex_replace(text, std::regex("^Could not convert: (.*)"), "$1: expected a number");
}

// Formats CLI11's help for the width of the terminal, and prints "(1 to 9)" instead of ":INT in [1
// - 9]".
class Readable final : public CLI::Formatter {
  std::string make_help(const CLI::App* app, std::string name,
                        CLI::AppFormatMode mode) const override {
    std::istringstream lines(Formatter::make_help(app, name, mode));
    const std::size_t known = columns_of_stdout(), columns = known > 0 ? known : 100;
    std::string out, line;
    for (bool examples = false; std::getline(lines, line);) {
      if (line.empty() && out.ends_with("\n\n")) continue;  // keeps only one blank line
      examples = examples ? !line.empty() : line == "Examples:";
      out += examples ? line + '\n' : wrapped(line + '\n', columns);
    }
    return out;
  }
  std::string make_description(const CLI::App* app) const override {
    return app->get_description() + "\n";
  }
  std::string make_option_opts(const CLI::Option* option) const override {
    const std::pair<const char*, const char*> plain[] = {
        {R"(:\w+ in \[(\S+) - (\S+)\])", " ($1 to $2)"},
        {R"(:\(\w+ in \[0 - 0\]\) OR \(\w+ in \[(\S+) - (\S+)\]\))", " (0, or $1 to $2)"},
        {":POSITIVE", " (above 0)"},
        {":NONNEGATIVE", " (at least 0)"}};
    std::string text = Formatter::make_option_opts(option);
    for (const auto& [was, now] : plain) text = std::regex_replace(text, std::regex(was), now);
    text = text.substr(0, std::min(text.find(" Needs:"), text.find(" Excludes:")));
    if (option->get_positional() && std::isupper(option->get_name(true).front()) != 0)
      text.erase(0, text.find(' ', 1));  // removes CLI11's type name
    return text;
  }
  std::string make_option_desc(const CLI::Option* option) const override {
    std::string others;
    for (const CLI::Option* other : option->get_excludes())
      others += (others.empty() ? "; cannot be combined with " : " or ") + other->get_name();
    for (const CLI::Option* other : option->get_needs())
      others += "; requires " + other->get_name();
    return option->get_description() + others;
  }
};

// CLI11 accepts "nan" for a number in any range.
std::string finite(const std::string& text) {
  return std::isfinite(std::strtod(text.c_str(), nullptr)) ? "" : text + ": expected a number";
}

std::string not_empty(const std::string& text) { return text.empty() ? "expected a name" : ""; }

// Returns true if the value of the option is the name of a file or folder.
bool is_name(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  return std::ranges::any_of(std::array{"FILE", "FOLDER", "MODEL", "RUN", "TABLE"},
                             [&](const char* kind) { return type.find(kind) != type.npos; });
}

// `above`: lines at the end of the help that refer to the parents' options.
void set_up(CLI::App& app, const std::shared_ptr<CLI::FormatterBase>& formatter,
            const std::string& above = {}, const std::string& path = {}) {
  app.formatter(formatter);
  if (app.get_help_ptr()) app.get_help_ptr()->description("print this help");
  if (app.get_version_ptr())
    app.get_version_ptr()->description("print the version and the git commit");
  const auto below = app.get_subcommands({});
  if (!below.empty()) app.footer("exit codes:  COMMAND --help lists them");
  if (below.empty() && !above.empty())
    app.footer(app.get_footer() + (app.get_footer().ends_with("\n") ? "\n" : "\n\n") + above);
  const std::string name = path + app.get_name();
  std::string own;
  for (CLI::Option* option : app.get_options()) {
    if (option->get_type_name().find("FLOAT") != std::string::npos) option->check(finite);
    if (is_name(*option)) option->check(not_empty);
    if (option != app.get_help_ptr() && option != app.get_version_ptr())
      own += (own.empty() ? "" : ", ") + option->get_name();
  }
  if (!own.empty()) own += ": see " + name + " --help\n";
  for (CLI::App* sub : below) set_up(*sub->fallthrough(), formatter, own + above, name + " ");
}

}  // namespace

void parse_command_line(CLI::App& app, int argc, const char* const* argv) {
  set_up(app, std::make_shared<Readable>());
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

void more_options(CLI::App& command, std::initializer_list<const char*> names) {
  for (const char* name : names) command.get_option(name)->group("More options");
}

void add_examples(CLI::App& command, std::initializer_list<const char*> lines,
                  const std::string& codes) {
  std::string text = "Examples:\n";
  for (const char* line : lines) text.append("  ").append(line).append("\n");
  command.footer(text + "\nexit codes:  0 ok, 1 failed, 2 usage" + (codes.empty() ? "" : ", ") +
                 codes);
}

}  // namespace echofuse
