// SPDX-License-Identifier: MIT
#include "recon/numbers/parallel.hpp"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "drivers/program/program.hpp"

namespace echofuse::recon {
namespace {

// A thread that wakes up late finds nothing left in its job, even if the next one has begun.
struct Job {
  Job(std::size_t part_count, const std::function<void(std::size_t)>& what)
      : parts(part_count), work(what) {}
  const std::size_t parts;
  const std::function<void(std::size_t)>& work;
  std::atomic<std::size_t> next{0}, done{0};

  void help() {
    for (std::size_t i; (i = next.fetch_add(1)) < parts;) {
      work(i);
      if (done.fetch_add(1) + 1 == parts) done.notify_one();
    }
  }
  void wait() {
    for (std::size_t n; (n = done.load()) < parts;) done.wait(n);
  }
};

class Pool {
 public:
  explicit Pool(int threads) {
    for (int i = 1; i < threads; ++i) workers_.emplace_back([this] { serve(); });
  }
  ~Pool() {
    give(nullptr);
    for (auto& w : workers_) w.join();
  }
  Pool(const Pool&) = delete;
  Pool& operator=(const Pool&) = delete;

  void run(std::size_t parts, const std::function<void(std::size_t)>& work) {
    if (workers_.empty() || parts < 2) {
      for (std::size_t i = 0; i < parts; ++i) work(i);
      return;
    }
    const auto job = std::make_shared<Job>(parts, work);
    give(job);
    job->help();
    job->wait();
  }

 private:
  void give(std::shared_ptr<Job> job) {
    {
      const std::lock_guard lock(mutex_);
      job_ = std::move(job);
      ++jobs_;
    }
    changed_.notify_all();
  }
  void serve() {
    std::shared_ptr<Job> job;
    for (std::size_t seen = 0;;) {
      {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return jobs_ != seen; });
        seen = jobs_, job = job_;
      }
      if (!job) return;
      job->help();
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::shared_ptr<Job> job_;  // null at the end
  std::size_t jobs_ = 0;
  std::vector<std::thread> workers_;
};

std::unique_ptr<Pool>& pool() {
  static auto it = std::make_unique<Pool>(static_cast<int>(usable_cores()));
  return it;
}

}  // namespace

void set_threads(int count) {
  if (count <= 0) count = static_cast<int>(usable_cores());
  pool() = std::make_unique<Pool>(count);
}

void for_each_part(std::size_t parts, const std::function<void(std::size_t)>& work) {
  pool()->run(parts, work);
}

}  // namespace echofuse::recon
