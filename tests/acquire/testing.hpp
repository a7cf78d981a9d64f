// SPDX-License-Identifier: MIT
// Common parts of the tests in this folder.
#pragma once

#include "../fixtures/damage.hpp"
#include "../fixtures/error.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/run.hpp"
#include "../fixtures/shell.hpp"
#include "acquire/record/sqlite.hpp"

namespace echofuse::test {

namespace fs = std::filesystem;

inline void write_file(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

// Returns the bytes after each LF was converted to CR LF.
inline Bytes saved_as_text(ByteView bytes) {
  Bytes out;
  for (const std::uint8_t b : bytes) {
    if (b == '\n') out.push_back('\r');
    out.push_back(b);
  }
  return out;
}

inline Outcome acquire(const std::string& arguments) {
  return shell(bin_dir + "/echofuse-acquire " + arguments);
}

// Returns the output of a command, which must have the exit code `code`.
inline std::string text_of(const Outcome& outcome, int code = 0) {
  CAPTURE(outcome.text);
  REQUIRE(outcome.code == code);
  return outcome.text;
}

inline std::string status_of(const std::string& path) {
  return record::RunReader(path).info().status;
}

// Returns the events of a run as "LEVEL SOURCE: TEXT".
inline std::vector<std::string> events_of(const std::string& path) {
  std::vector<std::string> out;
  for (const record::Event& e : record::RunReader(path).events())
    out.push_back(e.level + " " + e.source + ": " + e.text);
  return out;
}

// Connection of another program to a run file, for example during a transaction.
struct OtherProgram {
  explicit OtherProgram(const std::string& path) : db(record::open_database(path, "cannot open")) {}
  void ask(const char* statements) {
    record::execute(db.get(), "other program", statements, "cannot run");
  }
  record::DatabaseHandle db;
};

// Returns the warnings in a run that do not refer to a single record, one per line.
inline std::string warnings_of(const std::string& path) {
  std::string out;
  for (const auto& event : record::RunReader(path).events())
    if (event.level != "info" && !event.text.starts_with("record "))
      out += "\n" + event.source + ": " + event.text;
  return out;
}

// Checks that all columns and arrays of the two records are equal. Defined in run_rows.cpp.
void check_same(const FusedRecord& read, const FusedRecord& wrote);

}  // namespace echofuse::test

using namespace echofuse::test;
