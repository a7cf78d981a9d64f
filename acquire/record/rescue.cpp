// SPDX-License-Identifier: MIT
#include "acquire/record/rescue.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

#include "acquire/record/side_files.hpp"
#include "acquire/record/sqlite.hpp"
#include "drivers/util/new_file.hpp"

namespace echofuse::record {
namespace {

namespace fs = std::filesystem;

// Creates an empty file for the copy of the run and returns its name. Throws Error.
std::string create_next_to(const fs::path& path) {
  std::error_code none;
  const bool there = fs::is_directory(path.parent_path(), none);
  const fs::path folder = there ? path.parent_path() : fs::current_path(none);
  for (int n = 1;; ++n) {
    const auto copy = path.stem().string() + ".rescued" + (n > 1 ? std::to_string(-n) : "");
    const std::string name = (folder / (copy + path.extension().string())).string();
    const int fd = ::open(name.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0644);
    if (fd >= 0) {
      let_group_read(fd);
      ::close(fd);
      remove_side_files(name);
      return name;
    }
    if (errno != EEXIST) throw Error(ExitCode::disk, name + ": " + std::strerror(errno));
  }
}

DatabaseHandle open_copy(sqlite3* db, const std::string& name) {
  DatabaseHandle copy = open_database(name, "cannot open");
  sqlite3_backup* const backup = sqlite3_backup_init(copy.get(), "main", db, "main");
  if (!backup) sqlite_fail(copy.get(), name, "cannot copy");
  sqlite3_backup_step(backup, -1);
  if (sqlite3_backup_finish(backup) != SQLITE_OK) sqlite_fail(copy.get(), name, "cannot copy");
  return copy;
}

void remove_copy(const std::string& name) {
  if (name.empty()) return;
  ::unlink(name.c_str());
  remove_side_files(name);
}

}  // namespace

void put_end(sqlite3* db, const std::string& path, const std::string& status, UtcTime ended) {
  const std::string end =
      std::string("UPDATE run SET status = ?, ended_utc = ?, ") + without_wal_key;
  Statement(db, path, end.c_str()).bind(status).bind(iso8601(ended)).run();
}

std::string damage(sqlite3* db, const std::string& path) {
  try {
    sqlite3_db_release_memory(db);  // cached pages would hide damage in the file
    Statement check(db, path, "PRAGMA quick_check(1)");
    const std::string answer = check.step() ? check.text() : "no answer";
    return answer == "ok" ? "" : answer.substr(answer.rfind('\n') + 1);
  } catch (const Error&) {
    return sqlite3_errmsg(db);
  }
}

std::int64_t count_records(sqlite3* db, const std::string& path) {
  Statement count(db, path, "SELECT count(*) FROM record");
  count.step();
  return count.integer();
}

Rescue rescue(sqlite3* db, const std::string& path, const std::string& status, UtcTime ended,
              std::int64_t records) {
  std::string name;
  try {
    name = create_next_to(path);
    const DatabaseHandle copy = open_copy(db, name);
    sqlite3* const raw = copy.get();
    if (const std::string fault = damage(raw, name); !fault.empty())
      return {false, "the readable part is in " + name + ", which is damaged: " + fault};
    execute(raw, name, "PRAGMA journal_mode=DELETE", "cannot close");
    put_end(raw, name, status, ended);
    const std::int64_t found = count_records(raw, name);
    const std::string of = found == records ? "its " : std::to_string(found) + " of its ";
    return {found == records, of + std::to_string(records) + " records are in " + name};
  } catch (const std::exception& e) {
    remove_copy(name);
    return {false, std::string("nothing could be rescued: ") + e.what()};
  }
}

}  // namespace echofuse::record
