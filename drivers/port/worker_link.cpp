// SPDX-License-Identifier: MIT
#include "drivers/port/worker_link.hpp"

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <optional>

namespace echofuse::port {

struct WorkerLink::Io {
  boost::asio::io_context& context;
  std::optional<boost::asio::executor_work_guard<boost::asio::io_context::executor_type>> work;
};

WorkerLink::WorkerLink(boost::asio::io_context& io) : io_(new Io{io, std::nullopt}) {}
WorkerLink::~WorkerLink() = default;

void WorkerLink::begin(SampleSink& sink) {
  sink_ = &sink;
  io_->work.emplace(io_->context.get_executor());
}

void WorkerLink::stop() {
  const std::lock_guard lock(mutex_);
  stopping_ = true;
  wake_.notify_all();
}

void WorkerLink::leave() {
  sink_ = nullptr;
  io_->work.reset();
}

void WorkerLink::end() {
  boost::asio::post(io_->context, [self = shared_from_this()] {
    self->finished_ = true;
    self->leave();
  });
}

void WorkerLink::post(std::function<void(SampleSink&)> action) {
  boost::asio::post(io_->context, [self = shared_from_this(), action = std::move(action)] {
    if (self->sink_) action(*self->sink_);
  });
}

bool WorkerLink::pause(std::chrono::nanoseconds time) {
  std::unique_lock lock(mutex_);
  return !wake_.wait_for(lock, time, [this] { return stopping_.load(); });
}

}  // namespace echofuse::port
