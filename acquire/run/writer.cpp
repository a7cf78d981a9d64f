// SPDX-License-Identifier: MIT
#include "acquire/run/writer.hpp"

#include <spdlog/spdlog.h>

#include <filesystem>
#include <utility>

#include "acquire/run/disk_estimate.hpp"
#include "drivers/program/exit_code.hpp"

namespace echofuse::acquire {
namespace {

constexpr std::size_t hard_limit = 10;        // times the capacity
constexpr std::chrono::seconds last_wait{2};  // at the end, for who holds the file
constexpr const char* too_slow = "dropped: the disk does not keep up";

void give_up_data(record::FusedRecord& record) {
  for (const Sensor s : all_sensors)
    if (record.has(s)) record.sync[s].verdict = too_slow;
  record.valid = {};
  record.spd = {};
  record.radar = {};
  record.array = {};
  record.array_frames = 0;
  record.depth_mm = {};
}

bool is_disk(const std::exception_ptr& failure) {
  try {
    std::rethrow_exception(failure);
  } catch (const Error& error) {
    return error.code() == ExitCode::disk;
  } catch (...) {
    return false;
  }
}

}  // namespace

Writer::Writer(std::unique_ptr<record::RunWriter> run, std::unique_ptr<port::Worker> worker,
               std::size_t capacity)
    : run_(std::move(run)), capacity_(capacity), worker_(std::move(worker)) {
  run_->be_patient();
}

Writer::~Writer() { stop(); }

bool Writer::put(record::FusedRecord record) {
  bool room = waiting_ < capacity_;
  if (run_->waits()) {
    if (!std::exchange(reported_, true))
      spdlog::error("{}: another program holds it by a write transaction; records wait in memory",
                    run_->path());
    if (!room) run_->give_up_waiting({});
    room = true;
  }
  if (!room) give_up_data(record);
  put([this, r = std::move(record)](record::RunWriter& run) mutable {
    const UtcTime slot_end = r.slot_utc + (r.slot_end - r.slot_start);
    if (auto label = run.new_label(slot_end)) {
      const std::lock_guard lock(mutex_);
      label_ = std::move(label);
    }
    if (label_) r.label = *label_;
    run.append(r);
    spdlog::debug("record {}: committed", r.index);  // what scripts/kill_test relies on
    const auto free = acquire::free_bytes(std::filesystem::path(run.path()).parent_path().string());
    const std::lock_guard lock(mutex_);
    free_ = free;
    ++written_;
  });
  return room;
}

std::optional<std::uint64_t> Writer::free_bytes() const {
  const std::lock_guard lock(mutex_);
  return free_;
}

std::optional<std::string> Writer::label() const {
  const std::lock_guard lock(mutex_);
  return label_;
}

void Writer::put(Job job) {
  if (failed_ || !worker_) return;
  if (waiting_ >= hard_limit * capacity_)
    return fail(std::make_exception_ptr(Error(ExitCode::disk, too_slow)));
  ++waiting_;
  worker_->put([this, job = std::move(job)] {
    --waiting_;
    work(job);
  });
}

void Writer::fail(const std::exception_ptr& why) {
  const std::lock_guard lock(mutex_);
  if (!failure_) failure_ = why;
  failed_ = true;
}

void Writer::work(const Job& job) {
  if (failed_) return;
  try {
    try {
      job(*run_);
    } catch (const Error&) {
      if (!run_->move_if_held()) throw;
      moved_ = true;
      job(*run_);
    }
  } catch (...) {
    fail(std::current_exception());
  }
}

void Writer::stop() {
  run_->give_up_waiting(last_wait);
  worker_.reset();
}

bool Writer::finish(const std::string& status) {
  stop();
  if (!failed_) return run_->close(moved_ ? "stopped:disk" : status);
  try {
    run_->close(is_disk(failure_) ? "stopped:disk" : "stopped:failed");
  } catch (const Error&) {  // the first reason is the one to tell, unless this says what is left
    if (run_->lost()) throw;
  }
  std::rethrow_exception(failure_);
}

}  // namespace echofuse::acquire
