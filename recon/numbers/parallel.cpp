// SPDX-License-Identifier: MIT
#include "recon/numbers/parallel.hpp"

#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <memory>

#include "drivers/util/program.hpp"

namespace echofuse::recon {
namespace {

// Parts of one calculation. A thread that starts late does not find any remaining part of its job,
// even if the next job is already running.
struct ParallelJob {
  ParallelJob(std::size_t part_count, const std::function<void(std::size_t)>& what)
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

// Threads in addition to the one that calls for_each_part().
struct Helpers {
  explicit Helpers(std::size_t threads) : count(threads), pool(threads) {}
  std::size_t count;
  boost::asio::thread_pool pool;
};

std::unique_ptr<Helpers>& helpers() {
  static auto them = std::make_unique<Helpers>(usable_cores() - 1);
  return them;
}

}  // namespace

void set_threads(int count) {
  const unsigned all = count > 0 ? static_cast<unsigned>(count) : usable_cores();
  helpers() = std::make_unique<Helpers>(all - 1);
}

void for_each_part(std::size_t parts, const std::function<void(std::size_t)>& work) {
  Helpers& others = *helpers();
  if (others.count == 0 || parts < 2) {
    for (std::size_t i = 0; i < parts; ++i) work(i);
    return;
  }
  const auto job = std::make_shared<ParallelJob>(parts, work);
  for (std::size_t i = 0; i < std::min(others.count, parts - 1); ++i)
    boost::asio::post(others.pool, [job] { job->help(); });
  job->help();
  job->wait();
}

}  // namespace echofuse::recon
