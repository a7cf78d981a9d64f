// SPDX-License-Identifier: MIT
// Splits a .cfg file into commands. Errors contain the file name and the line number.
#pragma once
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/radar/profile.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::radar {

struct DemoCommand;

// Throws Error(config) if the text is too long, or if a CR is not followed by an LF.
void require_plain_text(std::string_view text, const std::string& name);

struct CfgCommand {
  int line = 0;
  std::vector<std::string_view> words;  // name of the command, followed by its arguments
};

class Cfg {
 public:
  // Adds the commands in `lines`. Stores in `profile` the reasons why a board would reject them.
  // `profile` must outlive this object. Throws Error(config) if the cfg is for another demo.
  Cfg(const std::vector<CfgLine>& lines, std::string name, RadarProfile& profile);

  // Runs `body` and stores the error that it throws, so that later checks still run.
  template <class Body>
  void attempt(Body body) const {
    try {
      body();
    } catch (const Error& e) {
      faulty_ = true;
      refuse(e.what());
    }
  }
  // Throws one Error containing all stored errors and refusals if at least one error was stored.
  void stop_if_faulty() const;
  void refuse(const std::string& line) const;
  void refuse(const CfgCommand& c, const std::string& what) const { refuse(complaint(c, what)); }
  std::string complaint(const CfgCommand& c, const std::string& what) const;
  [[noreturn]] void fail(const CfgCommand& c, const std::string& what) const;

  // Stores an error if the cfg does not contain the command.
  void require(const std::string& command);
  // Returns all commands with this name. Throws Error(config) if there are none.
  const std::vector<CfgCommand>& all(const std::string& command) const;
  // Returns the last command with this name, because the firmware uses the last one.
  const CfgCommand& last(const std::string& command) const { return all(command).back(); }
  bool has(const std::string& command) const { return commands_.count(command) != 0; }
  // Returns the last command with this name that applies to the subframe, or nullptr.
  const CfgCommand* of_subframe(const std::string& command, unsigned subframe) const;
  // Returns true if the cfg uses subframes (advFrameCfg), according to dfeDataOutputMode.
  bool advanced() const {
    return has("dfeDataOutputMode") && number(last("dfeDataOutputMode"), 1) == 3;
  }

  // Returns the i-th argument, counted from 1. Throws Error(config) if it is missing or not a
  // number.
  double number(const CfgCommand& c, std::size_t i) const;
  // Returns the i-th argument. Throws Error(config) if it is outside the range in the table of
  // commands (demo_commands.hpp).
  double checked(const CfgCommand& c, std::size_t i) const;
  std::uint32_t integer(const CfgCommand& c, std::size_t i) const {
    return static_cast<std::uint32_t>(checked(c, i));
  }
  const std::string& name() const { return name_; }
  std::string where(int line) const { return name_ + ":" + std::to_string(line) + ": "; }

 private:
  void add(const CfgLine& line);
  void check_words(const CfgCommand& c);
  void check_combination(const CfgCommand& c);
  void check_order(const CfgCommand& c, const DemoCommand& command);
  void check_start(const CfgCommand& start);
  // Returns the fault of the i-th argument, or an empty string.
  std::string outside(const CfgCommand& c, std::size_t i) const;

  std::string name_;
  RadarProfile& profile_;
  mutable bool faulty_ = false;
  std::map<std::string, std::vector<CfgCommand>> commands_;
  // Settings in the firmware after the lines read so far: the names of the commands, each name with
  // its key ("profileCfg/2"), and each subframe to which a command applies ("cfarCfg/0#1").
  std::set<std::string> settings_;
  std::set<std::string> missing_;  // settings that were reported as missing
};

}  // namespace echofuse::radar
