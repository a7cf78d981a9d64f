// SPDX-License-Identifier: MIT
// One .cfg file, split into commands, with complaints that name its lines.
#pragma once
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/program/exit_code.hpp"
#include "drivers/radar/profile.hpp"

namespace echofuse::radar {

// Throws Error(config) for a text in UTF-16, or with a CR that no LF follows.
void require_plain_text(std::string_view text, const std::string& name);

struct Command {
  int line = 0;
  std::vector<std::string_view> words;  // the name first
};

class Cfg {
 public:
  // Everything that the board will refuse, or the demo does not know, goes to the profile, which
  // has to outlive it. Throws Error(config) for a cfg of another demo.
  Cfg(const std::vector<CfgLine>& lines, std::string name, RadarProfile& profile);

  // Faults come together: those of one attempt do not hide the next one's.
  template <class Body>
  void attempt(Body body) const {
    try {
      body();
    } catch (const Error& e) {
      faulty_ = true;
      refuse(e.what());
    }
  }
  // With a fault, all that the board would refuse is one as well.
  void stop_if_faulty() const;
  void refuse(const std::string& line) const;
  std::string complaint(const Command& c, const std::string& what) const;
  [[noreturn]] void fail(const Command& c, const std::string& what) const;

  // All commands of a name; at least one, or an error.
  const std::vector<Command>& all(const std::string& command) const;
  // The last one counts, as in the firmware.
  const Command& last(const std::string& command) const { return all(command).back(); }
  bool has(const std::string& command) const { return commands_.count(command) != 0; }
  // Frames of subframes (advFrameCfg), as dfeDataOutputMode says.
  bool advanced() const {
    return has("dfeDataOutputMode") && number(last("dfeDataOutputMode"), 1) == 3;
  }

  // The i-th argument, from 1.
  double number(const Command& c, std::size_t i) const;
  // Wider than any board's, and narrow enough for the range axis to be finite.
  double positive(const Command& c, std::size_t i, const char* meaning) const;
  std::uint32_t integer(const Command& c, std::size_t i, double min, double max) const;
  const std::string& name() const { return name_; }
  std::string where(int line) const { return name_ + ":" + std::to_string(line) + ": "; }

 private:
  void add(const CfgLine& line);
  void check_words(const Command& c) const;

  std::string name_;
  RadarProfile& profile_;
  mutable bool faulty_ = false;
  std::map<std::string, std::vector<Command>> commands_;
};

}  // namespace echofuse::radar
