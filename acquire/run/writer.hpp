// SPDX-License-Identifier: MIT
// The run file's own worker: what the daemon gathers goes to disk in order, and a slow disk never
// blocks the devices.
#pragma once
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "acquire/record/run_file.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::acquire {

// Threading: all members are for one thread. The worker alone touches the RunWriter. No job
// is done after the first that failed, and finish() tells why. While another program
// holds the run file by a write transaction, jobs wait; when no more can wait, or at the end, the
// RunWriter moves to a copy beside, and the run ends with an Error that names it.
class Writer {
 public:
  using Job = std::function<void(record::RunWriter&)>;
  static constexpr std::size_t default_capacity = 64;

  Writer(std::unique_ptr<record::RunWriter> run, std::unique_ptr<port::Worker> worker,
         std::size_t capacity = default_capacity);
  ~Writer();  // without finish(): the run stays as a crash would leave it
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  // False if `capacity` jobs are waiting: then the record's data are given up, but its row is still
  // written, with that verdict. Ten times as many jobs fail the writer.
  bool put(record::FusedRecord record);
  void put(Job job);
  // Half of `capacity` jobs are waiting: who has many records at once gives the disk its time.
  bool crowded() const { return waiting_ >= capacity_ / 2; }

  bool failed() const { return failed_ || moved_; }
  std::int64_t written() const { return written_; }
  // That a mark gave to the records written last; none if none did.
  std::optional<std::string> label() const;
  // Of the run's disk after the last record; none if it does not tell.
  std::optional<std::uint64_t> free_bytes() const;
  // Writes what is waiting and closes the run with this status, or, if a job failed, with
  // "stopped:disk" or (for another reason) "stopped:failed"; then throws that job's Error. False if
  // a reader keeps the run from being one file (RunWriter::close).
  bool finish(const std::string& status);

 private:
  void work(const Job& job);
  void fail(const std::exception_ptr& why);
  void stop();

  std::unique_ptr<record::RunWriter> run_;
  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::atomic<std::size_t> waiting_ = 0;  // jobs that have not begun
  std::atomic<bool> failed_ = false, moved_ = false;
  bool reported_ = false;  // that another program holds the file
  std::atomic<std::int64_t> written_ = 0;
  std::optional<std::string> label_;   // set by a mark, by the worker; guarded by mutex_
  std::optional<std::uint64_t> free_;  // on its disk; guarded by mutex_
  std::exception_ptr failure_;         // set once, before failed_
  std::unique_ptr<port::Worker> worker_;
};

}  // namespace echofuse::acquire
