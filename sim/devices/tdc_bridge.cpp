// SPDX-License-Identifier: MIT
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <deque>

#include "sim/devices/tag_stream.hpp"
#include "sim/encode.hpp"

namespace echofuse::sim {
namespace {

using boost::asio::ip::tcp;
using ErrorCode = boost::system::error_code;

constexpr auto tick = std::chrono::milliseconds(5);
constexpr auto hello_pause = std::chrono::milliseconds(900);
constexpr char hello[] =
    R"({"model":"simulated time tagger","serial":"SIM-TDC-1","firmware":"1.0"})";

class Bridge final : public TdcBridge {
 public:
  Bridge(boost::asio::io_context& io, Stage& stage, const TdcOptions& options)
      : options_(options),
        stream_(stage, options),
        acceptor_(io, {boost::asio::ip::address_v4::loopback(), options.port}),
        address_("bridge:tcp://127.0.0.1:" + std::to_string(acceptor_.local_endpoint().port())),
        socket_(io),
        timer_(io) {
    accept();
    wait();
  }

  std::string address() const override { return address_; }

  void stop() override {
    stopping_ = true;
    timer_.cancel();
    acceptor_.close();
    if (connected_) enqueue(BlockKind::bye, {}, 0);
  }

  std::vector<std::pair<std::string, std::uint64_t>> sent() const override {
    return {{"clients", clients_}, {"blocks", blocks_}, {"tags", tags_}, {"dropped", all_dropped_}};
  }

 private:
  struct Block {
    Bytes bytes;
    std::size_t tags;
  };

  void accept() {
    acceptor_.async_accept([this](const ErrorCode& error, tcp::socket socket) {
      if (error) {
        if (!stopping_) accept();
        return;
      }
      socket_ = std::move(socket);
      ErrorCode ignored;
      socket_.set_option(tcp::no_delay(true), ignored);
      connected_ = true;
      ++clients_;
      sequence_ = 0;
      dropped_ = 0;
      stream_.start();
      greet();
      watch();
    });
  }

  void greet() {
    enqueue(BlockKind::hello, {reinterpret_cast<const std::uint8_t*>(hello), sizeof hello - 1}, 0);
    next_hello_ = std::chrono::steady_clock::now() + hello_pause;
  }

  // A client sends nothing; what ends this read is that he is gone.
  void watch() {
    socket_.async_read_some(boost::asio::buffer(unread_), [this](const ErrorCode& error, auto) {
      if (error == boost::asio::error::operation_aborted) return;
      if (error)
        disconnect();
      else
        watch();
    });
  }

  void disconnect() {
    if (!connected_) return;
    connected_ = false;
    ErrorCode ignored;
    socket_.close(ignored);
    if (!writing_) next_client();
  }

  // Only once the last write of the former client has ended: its buffers are in the queue.
  void next_client() {
    queue_.clear();
    queued_bytes_ = 0;
    if (!stopping_) accept();
  }

  void wait() {
    timer_.expires_after(tick);
    timer_.async_wait([this](const ErrorCode& error) {
      if (error) return;
      if (connected_ && std::chrono::steady_clock::now() > next_hello_) greet();
      if (connected_)
        stream_.advance(
            [this](ByteView tags, std::size_t count) { enqueue(BlockKind::tags, tags, count); },
            [this](std::uint64_t tags) { drop(tags); });
      wait();
    });
  }

  void enqueue(BlockKind kind, ByteView payload, std::size_t tags) {
    if (queued_bytes_ + payload.size() > options_.send_queue_bytes) return drop(tags);
    queue_.push_back({bridge_block(kind, sequence_++, dropped_, payload), tags});
    queued_bytes_ += queue_.back().bytes.size();
    dropped_ = 0;
    if (!writing_) write();
  }

  void drop(std::uint64_t tags) {
    dropped_ += tags;
    all_dropped_ += tags;
  }

  void write() {
    writing_ = true;
    boost::asio::async_write(socket_, boost::asio::buffer(queue_.front().bytes),
                             [this](const ErrorCode& error, std::size_t) {
                               writing_ = false;
                               written(error);
                             });
  }

  void written(const ErrorCode& error) {
    if (!connected_) return next_client();
    if (error) return disconnect();
    ++blocks_;
    tags_ += queue_.front().tags;
    queued_bytes_ -= queue_.front().bytes.size();
    queue_.pop_front();
    if (!queue_.empty())
      write();
    else if (stopping_)
      disconnect();
  }

  TdcOptions options_;
  TagStream stream_;
  tcp::acceptor acceptor_;
  std::string address_;
  tcp::socket socket_;
  boost::asio::steady_timer timer_;
  std::array<std::uint8_t, 256> unread_{};
  std::deque<Block> queue_;
  std::size_t queued_bytes_ = 0;
  bool connected_ = false, writing_ = false, stopping_ = false;
  std::uint32_t sequence_ = 0;
  std::chrono::steady_clock::time_point next_hello_;
  std::uint64_t dropped_ = 0, all_dropped_ = 0, clients_ = 0, blocks_ = 0, tags_ = 0;
};

}  // namespace

std::unique_ptr<TdcBridge> make_tdc_bridge(boost::asio::io_context& io, Stage& stage,
                                           const TdcOptions& options) {
  return std::make_unique<Bridge>(io, stage, options);
}

}  // namespace echofuse::sim
