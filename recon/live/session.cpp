// SPDX-License-Identifier: MIT
#include "recon/live/session.hpp"

#include <cstdio>
#include <exception>

#include "drivers/util/printable.hpp"

namespace echofuse::view {
namespace {

namespace beast = boost::beast;
namespace websocket = beast::websocket;
constexpr auto timeout = std::chrono::seconds(10);
constexpr std::size_t max_marks = 8;  // maximum number of pending marks

}  // namespace

bool guarded(const std::function<void()>& body) {
  try {
    body();
    return true;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "echofuse-view: %s\n", printable(e.what(), 300).c_str());
    return false;
  }
}

// Runs the body of a handler. If the body throws an exception, only this session ends.
void Session::handle(const std::function<void()>& body) {
  if (!guarded(body)) close();
}

void Session::start() {
  parser_.emplace();
  parser_->header_limit(max_header_bytes);
  parser_->body_limit(std::uint64_t{0});
  beast::get_lowest_layer(stream_).expires_after(timeout);
  http::async_read(stream_.next_layer(), buffer_, *parser_,
                   [self = shared_from_this()](beast::error_code error, std::size_t) {
                     if (!error) self->handle([&] { self->on_request(); });
                   });
}

void Session::on_request() {
  request_ = parser_->release();
  const bool socket = websocket::is_upgrade(request_);
  caller_ = caller_of(request_, owner_.access(), socket);
  const bool program = caller_.path.size() > 1 && page_file(caller_.path.substr(1));
  if (caller_.refusal == http::status::ok && !program && !owner_.has_run(caller_.run))
    caller_.refusal = http::status::not_found,
    caller_.why = "the folder contains no run with this name";
  if (socket && caller_.refusal == http::status::ok) return upgrade();
  response_ = respond(request_, caller_, [this] { return owner_.runs(); });
  http::async_write(stream_.next_layer(), response_,
                    [self = shared_from_this()](beast::error_code, std::size_t) {
                      beast::error_code none;
                      beast::get_lowest_layer(self->stream_)
                          .socket()
                          .shutdown(boost::asio::ip::tcp::socket::shutdown_send, none);
                    });
}

void Session::upgrade() {
  beast::get_lowest_layer(stream_).expires_never();
  stream_.set_option(websocket::stream_base::timeout{
      .handshake_timeout = timeout, .idle_timeout = timeout, .keep_alive_pings = true});
  stream_.read_message_max(max_request_bytes);
  stream_.binary(true);
  stream_.auto_fragment(false);  // sends each message as one frame
  stream_.async_accept(request_, [self = shared_from_this()](beast::error_code error) {
    if (error) return;
    self->handle([&] {
      self->owner_.opened(self);
      self->read();
    });
  });
}

void Session::read() {
  stream_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
    if (error) return self->close();
    self->handle([&] {
      self->on_message();
      self->read();
    });
  });
}

void Session::on_message() {
  const auto bytes = buffer_.data();
  const Request request = parse_request({static_cast<const char*>(bytes.data()), bytes.size()});
  buffer_.consume(buffer_.size());
  if (std::holds_alternative<ShowSheet>(request))
    sheet_ = request;
  else if (std::holds_alternative<ShowSum>(request))
    sum_ = request;
  else if (std::holds_alternative<ShowLive>(request) || std::holds_alternative<ShowRecord>(request))
    record_ = request;
  else if (marks_.size() < max_marks)
    marks_.push_back(request);
  else
    return close();
  serve();
}

// Answers pending requests only while the send queue is empty. A client that does not read its
// messages therefore does not cause any work.
void Session::serve() {
  if (writing_ || over_) return;
  for (auto [pending, kind] : {std::pair{&record_, MessageKind::record},
                               {&sum_, MessageKind::sum},
                               {&sheet_, MessageKind::sheet}})
    if (*pending && !waiting_[static_cast<std::size_t>(kind)]) {
      const Request request = *std::exchange(*pending, std::nullopt);
      send(kind, owner_.answer_to(*this, request));
    }
  if (marks_.empty() || waiting_[static_cast<std::size_t>(MessageKind::answer)]) return;
  const Request mark = std::move(marks_.front());
  marks_.pop_front();
  send(MessageKind::answer, owner_.answer_to(*this, mark));
}

void Session::send(MessageKind kind, Message message) {
  if (!message || over_) return;
  waiting_[static_cast<std::size_t>(kind)] = std::move(message);
  if (!writing_) write_next();
}

void Session::write_next() {
  for (Message& message : waiting_)
    if (message) {
      writing_ = std::exchange(message, nullptr);
      break;
    }
  if (!writing_) return serve();
  stream_.async_write(boost::asio::buffer(*writing_),
                      [self = shared_from_this()](beast::error_code error, std::size_t) {
                        self->writing_.reset();
                        if (error) return self->close();
                        self->handle([&] { self->write_next(); });
                      });
}

void Session::close() {
  if (std::exchange(over_, true)) return;
  beast::get_lowest_layer(stream_).close();
  owner_.closed(shared_from_this());
}

}  // namespace echofuse::view
