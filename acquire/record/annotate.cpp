// SPDX-License-Identifier: MIT
#include "acquire/record/annotate.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <thread>

#include "acquire/record/rows.hpp"
#include "acquire/record/run_guard.hpp"
#include "acquire/record/run_reader.hpp"
#include "acquire/record/side_files.hpp"
#include "acquire/record/writer_lock.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::record {

namespace {

// Much longer than the recording process needs for a commit, but shorter than its own wait for
// other programs, so that notes cannot end a run.
constexpr int timeout_ms = 10'000;
constexpr auto retry_pause = std::chrono::milliseconds(20);

[[noreturn]] void refuse_closed(const std::string& path) {
  throw Error(ExitCode::failed,
              path + ": run is not being recorded; only a live run can be relabelled");
}

[[noreturn]] void cannot_annotate(const std::string& path, ExitCode code, const std::string& why) {
  throw Error(code, printable(path) + ": cannot be annotated: " + why);
}

// Adds the event to an open run. Returns false, without writing, if the run has been closed.
bool put_into_open(const std::string& path, const Event& event) {
  const DatabaseHandle file = open_database(path, "cannot open for writing");
  sqlite3* const db = file.get();
  harden(db);
  sqlite3_busy_timeout(db, timeout_ms);
  sqlite3_wal_autocheckpoint(db, 0);  // only the recording process runs checkpoints
  sqlite3_db_config(db, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  execute(db, path, "BEGIN IMMEDIATE", "cannot write");
  if (journal_version(db) == 1) return false;  // the run cannot be closed during this transaction
  const bool open = Statement(db, path, "SELECT 1 FROM run WHERE status = 'open'").step();
  // The recording process reads no labels after it has closed the run.
  if (event.level == "label" && !open) refuse_closed(path);
  if (open && !WriterLock::someone_writes(path))
    cannot_annotate(path, ExitCode::failed,
                    "its recording process was killed before it closed the run");
  insert(db, path, event);
  execute(db, path, "COMMIT", "cannot write");
  rebind_wal(db, path);
  return true;
}

void copy_into(NewFile& copy, const std::string& path) {
  const std::size_t size = RegularFile(path, ExitCode::failed).size();
  struct stat like {};
  if (::stat(path.c_str(), &like) != 0 || ::access(path.c_str(), W_OK) != 0)
    cannot_annotate(path, ExitCode::disk, std::strerror(errno));
  const auto folder = std::filesystem::path(path).parent_path();
  constexpr std::uintmax_t note = 1 << 20;  // upper limit of the space that a note needs, in bytes
  if (const auto room = std::filesystem::space(folder).available; room < size + note)
    cannot_annotate(path, ExitCode::disk,
                    std::to_string(room >> 20) +
                        " MiB free on its disk, but the copy needs at least " +
                        std::to_string((size + note) >> 20));
  copy.create();
  const bool same_owner = ::chown(copy.path().c_str(), like.st_uid, like.st_gid) == 0;
  if (!same_owner || ::chmod(copy.path().c_str(), like.st_mode & 07777) != 0)
    cannot_annotate(path, ExitCode::disk, "cannot set owner and mode of the copy");
  copy.append_file(path);
}

// Adds the event to a closed run. Returns false if another process holds the run's lock or the run
// is open.
bool put_into_closed(const std::string& path, const Event& event) {
  const WriterLock lock(path);
  if (!lock.held() || !is_closed(path)) return false;
  try {
    NewFile copy(path, path + "-new");
    copy_into(copy, path);
    {
      const DatabaseHandle file = open_database(copy.path(), "cannot open for writing");
      harden(file.get());
      // Keeps the journal in memory instead of a -journal file. If this process is killed, the next
      // writer removes the copy, but it would not remove a -journal.
      execute(file.get(), copy.path(), "PRAGMA journal_mode=MEMORY", "cannot write");
      insert(file.get(), copy.path(), event);
    }
    copy.publish();
  } catch (...) {
    lock.remove();
    throw;
  }
  lock.remove();
  return true;
}

void put(const std::string& name, const std::string& level, const std::string& text,
         const std::string& who) {
  const std::string path = real_path(name);
  const Event event{iso8601(system_clock.utc()), level, who, text};
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(timeout_ms);
  while (true) {
    if (!is_closed(path) && put_into_open(path, event)) return;
    if (level == "label") refuse_closed(name);
    if (put_into_closed(path, event)) return;
    if (std::chrono::steady_clock::now() >= end)
      cannot_annotate(name, ExitCode::failed, "another process is writing to it");
    std::this_thread::sleep_for(retry_pause);
  }
}

}  // namespace

void put_note(const std::string& path, const std::string& text, const std::string& who) {
  if (text.find_first_not_of(" \t\r\n") == std::string::npos)
    throw Error(ExitCode::usage, "the note is empty; expected a text");
  // RunReader throws if `path` is not a run file.
  if (RunReader(path).info().status == crashed_without_wal)
    cannot_annotate(
        path, ExitCode::failed,
        "it is a copy without its -wal file; closing it would lose the records in the -wal file");
  put(path, "note", text, who);
}

void put_label(const std::string& path, const std::string& label, const std::string& who) {
  if (RunReader(path).info().status != "open") refuse_closed(path);
  put(path, "label", label, who);
}

}  // namespace echofuse::record
