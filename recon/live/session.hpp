// SPDX-License-Identifier: MIT
// Handles one connection, from the HTTP request until it is closed.
#pragma once
#include <utility>  // must precede Asio (http.hpp)
// clang-format off: the header above comes first
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
// clang-format on
#include <array>
#include <deque>
#include <memory>
#include <optional>

#include "recon/live/http.hpp"
#include "recon/live/message.hpp"

namespace echofuse::view {

enum class MessageKind : std::uint8_t {
  run,
  trouble,
  state,
  reference,
  strip,
  record,
  sum,
  sheet,
  answer
};
inline constexpr std::size_t kinds = 9;

class Session;

// Server functions called by its sessions.
class SessionOwner {
 public:
  virtual ~SessionOwner() = default;
  virtual const Access& access() const = 0;
  virtual bool has_run(const std::string& name) = 0;
  virtual std::string runs() = 0;  // returns the list of runs as JSON text
  // Called when a WebSocket has been opened.
  virtual void opened(const std::shared_ptr<Session>& session) = 0;
  virtual void closed(const std::shared_ptr<Session>& session) = 0;
  // Returns null if the request does not require an answer.
  virtual Message answer_to(Session& session, const Request& request) = 0;
};

// Runs the body of a handler. If it throws, prints the exception on stderr and returns false. An
// uncaught exception would end the program.
bool guarded(const std::function<void()>& body);

// One connection. Threading: must be used from the thread of its owner. The owner must outlive the
// connection.
class Session : public std::enable_shared_from_this<Session> {
 public:
  Session(boost::asio::ip::tcp::socket socket, SessionOwner& owner, int& open)
      : stream_(std::move(socket)), owner_(owner), open_(open) {
    ++open_;
  }
  ~Session() { --open_; }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  void start();
  // Queues a message for sending. Replaces a queued message of the same kind.
  void send(MessageKind kind, Message message);
  bool may_write() const { return caller_.may_write; }
  const std::string& run() const { return caller_.run; }

  bool live = true;       // true: displays the newest record
  std::int64_t held = 0;  // index of the displayed record if `live` is false
  std::optional<ShowSum> summed;

 private:
  void handle(const std::function<void()>& body);
  void on_request();
  void upgrade();
  void read();
  void on_message();
  void serve();
  void write_next();
  void close();

  boost::beast::websocket::stream<boost::beast::tcp_stream> stream_;
  boost::beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::empty_body>> parser_;
  HttpRequest request_;
  HttpResponse response_;
  SessionOwner& owner_;
  int& open_;
  Caller caller_;
  bool over_ = false;
  Message writing_;
  std::array<Message, kinds> waiting_;
  std::optional<Request> record_, sum_, sheet_;  // newest pending request of each kind
  std::deque<Request> marks_;  // pending mark and label requests, in order of arrival
};

}  // namespace echofuse::view
