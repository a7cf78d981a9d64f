// SPDX-License-Identifier: MIT
// A .cfg file split into commands, with errors that name its lines.
#pragma once
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/radar/profile.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::radar {

// Throws Error(config) for UTF-16, or a CR without LF.
void require_plain_text(std::string_view text, const std::string& name);

struct CfgCommand {
  int line = 0;
  std::vector<std::string_view> words;  // command name first
};

class Cfg {
 public:
  // Adds the commands. Records refusals of the board and unknown commands in the profile, which
  // must outlive this object. Throws Error(config) for a cfg of another demo.
  Cfg(const std::vector<CfgLine>& lines, std::string name, RadarProfile& profile);

  // Runs body and collects its fault, so that later checks still run.
  template <class Body>
  void attempt(Body body) const {
    try {
      body();
    } catch (const Error& e) {
      faulty_ = true;
      refuse(e.what());
    }
  }
  // If there is a fault, throws it together with the board's refusals.
  void stop_if_faulty() const;
  void refuse(const std::string& line) const;
  std::string complaint(const CfgCommand& c, const std::string& what) const;
  [[noreturn]] void fail(const CfgCommand& c, const std::string& what) const;

  // Returns all commands of this name; an error if there are none.
  const std::vector<CfgCommand>& all(const std::string& command) const;
  // Returns the last command of this name, which is the effective one in the firmware.
  const CfgCommand& last(const std::string& command) const { return all(command).back(); }
  bool has(const std::string& command) const { return commands_.count(command) != 0; }
  // Returns true for frames with subframes (advFrameCfg), from dfeDataOutputMode.
  bool advanced() const {
    return has("dfeDataOutputMode") && number(last("dfeDataOutputMode"), 1) == 3;
  }

  // Returns the i-th argument, from 1.
  double number(const CfgCommand& c, std::size_t i) const;
  // Allows a wider range than any board, but keeps the range axis finite.
  double positive(const CfgCommand& c, std::size_t i, const char* meaning) const;
  std::uint32_t integer(const CfgCommand& c, std::size_t i, double min, double max) const;
  const std::string& name() const { return name_; }
  std::string where(int line) const { return name_ + ":" + std::to_string(line) + ": "; }

 private:
  void add(const CfgLine& line);
  void check_words(const CfgCommand& c) const;

  std::string name_;
  RadarProfile& profile_;
  mutable bool faulty_ = false;
  std::map<std::string, std::vector<CfgCommand>> commands_;
};

}  // namespace echofuse::radar
