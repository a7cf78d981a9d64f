// SPDX-License-Identifier: MIT
// Common part of the ports that use a device on a separate thread. Only .cpp files in this folder
// may include this header, because it includes Asio.
#pragma once
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "drivers/port/byte_port.hpp"

namespace echofuse::port {

// State shared by the loop's thread and the port's thread. Only the loop's thread uses `handlers`,
// `open` and `closed`.
struct ThreadLink {
  explicit ThreadLink(boost::asio::io_context& context) : io(&context) {}

  std::mutex io_mutex;
  boost::asio::io_context* io;  // null once the port has been destroyed
  PortHandlers handlers;
  bool open = false, closed = false;
  std::atomic<bool> stopping{false};
};

// Posts the action to the loop's thread. The action does not run if the port has been closed by
// then.
template <class Link, class Action>
void post(const std::shared_ptr<Link>& link, Action action) {
  const std::lock_guard lock(link->io_mutex);
  if (!link->io) return;
  boost::asio::post(*link->io, [link, action = std::move(action)]() mutable {
    if (!link->closed) action(*link);
  });
}

template <class Link>
void post_opened(const std::shared_ptr<Link>& link) {
  post(link, [](Link& opened) {
    opened.open = true;
    opened.handlers.opened();
  });
}

inline Failure failure(std::errc code, std::string what) {
  return {std::make_error_code(code), std::move(what)};
}

// `Worker` is constructed from the link and the constructor's other arguments. serve() runs on the
// port's thread. It returns the device's failure, or nullopt once the link is `stopping`.
template <class Link, class Worker>
class ThreadPort : public BytePort {
 public:
  template <class... Args>
  explicit ThreadPort(boost::asio::io_context& io, const Args&... args)
      : link_(std::make_shared<Link>(io)), worker_(std::make_unique<Worker>(link_, args...)) {}
  ~ThreadPort() override {
    // Limits how long the loop's thread waits for the port's thread. A request to a faulty device
    // may take seconds and would block the other devices.
    constexpr auto close_timeout = std::chrono::milliseconds(200);
    link_->closed = true;
    link_->stopping = true;
    if (!thread_.joinable()) return;
    if (ended_.wait_for(close_timeout) == std::future_status::ready) {
      thread_.join();
      return;
    }
    {
      const std::lock_guard lock(link_->io_mutex);
      link_->io = nullptr;
    }
    thread_.detach();
  }
  ThreadPort(const ThreadPort&) = delete;
  ThreadPort& operator=(const ThreadPort&) = delete;

  void open(PortHandlers handlers) override {
    link_->handlers = std::move(handlers);
    std::promise<void> end;
    ended_ = end.get_future();
    thread_ =
        std::thread([link = link_, worker = std::move(worker_), end = std::move(end)]() mutable {
          const std::optional<Failure> wrong = worker->serve();
          worker.reset();  // closes the device
          if (wrong)
            post(link, [wrong](Link& gone) {
              gone.closed = true;
              gone.open = false;
              gone.handlers.gone(*wrong);
            });
          end.set_value();
        });
  }

 protected:
  std::shared_ptr<Link> link_;

 private:
  std::unique_ptr<Worker> worker_;
  std::thread thread_;
  std::future<void> ended_;
};

}  // namespace echofuse::port
