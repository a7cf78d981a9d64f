// SPDX-License-Identifier: MIT
// The log says what a laboratory really did, one JSON object a line:
//   {"t": host monotonic ns, "device": "tdc", "what": "sent", NAME: NUMBER...}
// sim/README.md lists what each device writes.
#pragma once
#include <fstream>
#include <initializer_list>
#include <string>
#include <utility>

#include "drivers/core/clock.hpp"
#include "drivers/program/exit_code.hpp"

namespace echofuse::sim {

class SentLog {
 public:
  using Numbers = std::initializer_list<std::pair<const char*, std::int64_t>>;

  // Throws Error(disk) if the file cannot be made.
  explicit SentLog(const std::string& path) : path_(path), out_(path, std::ios::binary) { check(); }

  void put(HostTime time, const char* device, const char* what, Numbers numbers) {
    out_ << "{\"t\":" << time.count() << ",\"device\":\"" << device << "\",\"what\":\"" << what
         << '"';
    for (const auto& [name, value] : numbers) out_ << ",\"" << name << "\":" << value;
    out_ << "}\n";
  }
  // Closes the file. Throws Error(disk) if not all was written.
  void close() {
    out_.close();
    check();
  }

 private:
  void check() {
    if (!out_) throw Error(ExitCode::disk, path_ + ": cannot write the log");
  }

  std::string path_;
  std::ofstream out_;
};

}  // namespace echofuse::sim
