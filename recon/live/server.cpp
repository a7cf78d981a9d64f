// SPDX-License-Identifier: MIT
#include "recon/live/server.hpp"

#include <ifaddrs.h>
#include <netinet/in.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <set>

#include "acquire/record/annotate.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"
#include "recon/live/chooser.hpp"
#include "recon/live/session.hpp"

namespace echofuse::view {
namespace {

namespace net = boost::asio;
using net::ip::tcp;
using Error_code = boost::system::error_code;

constexpr unsigned short usual_port = 8410;
constexpr int usual_ports = 10;
constexpr auto pulse_pause = std::chrono::milliseconds(250);
constexpr auto longest_pause = std::chrono::milliseconds(200);
constexpr auto shortest_pause = std::chrono::milliseconds(25);
constexpr double state_pause_s = 1, strip_pause_s = 2;
constexpr double end_wait_s = 5;     // --until-closed: time to wait after the end of the run, s
constexpr double start_wait_s = 60;  // --until-closed: time to wait for the start of a run, s

tcp::endpoint endpoint_of(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  Error_code bad;
  std::string host = text.substr(0, std::min(colon, text.size()));
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  const auto address = net::ip::make_address(host, bad);
  char* end = nullptr;
  const std::string port = colon == text.npos ? "" : text.substr(colon + 1);
  const long number = std::strtol(port.c_str(), &end, 10);
  const bool digits = !port.empty() && port.find_first_not_of("0123456789") == port.npos;
  if (bad || !digits || *end || number > 65'535)
    throw Error(ExitCode::usage, "--listen " + printable(text) +
                                     ": expected ADDRESS:PORT with a numeric address, e.g. "
                                     "127.0.0.1:8410 or 0.0.0.0:8410");
  return {address, static_cast<unsigned short>(number)};
}

// Returns an address at which other machines reach this one: that of its first network interface
// with IPv4; 127.0.0.1 if no interface has one.
net::ip::address public_address() {
  net::ip::address out = net::ip::address_v4::loopback();
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return out;
  for (const ifaddrs* one = all; one && out.is_loopback(); one = one->ifa_next)
    if (one->ifa_addr && one->ifa_addr->sa_family == AF_INET)
      out = net::ip::address_v4(
          ntohl(reinterpret_cast<const sockaddr_in*>(one->ifa_addr)->sin_addr.s_addr));
  ::freeifaddrs(all);
  return out;
}

// A run displayed by at least one browser, or the default run.
struct ServedRun {
  ServedRun(const std::string& target, const LiveModel* model, std::optional<std::int64_t> planned,
            const Clock& clock)
      : run(target), messages(run, model, planned, clock) {}
  FollowedRun run;
  RunMessages messages;
  std::set<std::shared_ptr<Session>> sessions;
  bool has_reference = false;
  int edition = 0;
  HostTime state{}, strip{};
};

}  // namespace

class Server::Impl final : public SessionOwner {
 public:
  Impl(const ServerOptions& options, const LiveModel* model, const Clock& clock)
      : options_(options),
        model_(model),
        clock_(clock),
        home_(options.run, model, options.planned, clock),
        chooser_(options.run, clock) {
    access_.token = make_token();
    access_.many = std::filesystem::is_directory(options.run);
    listen();
    access_.loopback = acceptor_.local_endpoint().address().is_loopback();
    access_.needs_token = !access_.loopback;
  }

  std::string missing() {
    if (access_.many) return {};
    home_.run.refresh();
    const std::string& why = home_.run.trouble();
    if (!why.empty() && !home_.run.path().empty()) throw Error(ExitCode::failed, why);
    return why;
  }

  std::string address() const {
    const auto at = acceptor_.local_endpoint();
    const auto shown = at.address().is_unspecified() ? public_address() : at.address();
    const std::string host = shown.is_v6() ? "[" + shown.to_string() + "]" : shown.to_string();
    return "http://" + host + ":" + std::to_string(at.port()) +
           (access_.many && options_.until_closed ? "/newest/" : "/") + "?token=" + access_.token;
  }

  void run() {
    begun_ = clock_.now();
    accept();
    pulse();
    io_.run();
  }

 private:
  const Access& access() const override { return access_; }
  bool has_run(const std::string& name) override {
    return name.empty() || !chooser_.path_of(name).empty();
  }
  std::string runs() override { return chooser_.runs(); }
  void opened(const std::shared_ptr<Session>& session) override;
  void closed(const std::shared_ptr<Session>& session) override;
  Message answer_to(Session& session, const Request& request) override;
  Message mark(const Session& session, const Mark& mark);
  Message sum(ServedRun& served, const Session& session);

  void listen();
  void accept();
  void pulse();
  bool over();
  void arm();
  void update(ServedRun& served);
  void send_updates(ServedRun& served, bool news);
  // Returns true and sets `last` to the current time if at least `pause_s` has passed since `last`.
  bool is_due(HostTime& last, double pause_s) const {
    const HostTime now = clock_.now();
    return seconds(now - last) >= pause_s && (last = now, true);
  }
  void greet(ServedRun& served, Session& session);
  Message newest(ServedRun& served);
  void send_record(ServedRun& served, Session& session, const Message& record);
  ServedRun& served_run(const Session& session);
  // Calls action(served) for each run displayed by at least one browser.
  template <class Action>
  void each(Action action);
  template <class Make>
  Message attempt(Make make);

  // Number of connections. Declared before io_, because sessions in io_ decrement it when
  // destroyed.
  int open_ = 0;
  net::io_context io_;  // declared before the objects that use it, so that it outlives them
  tcp::acceptor acceptor_{io_};
  net::steady_timer pulse_{io_}, update_timer_{io_}, retry_{io_};
  const ServerOptions options_;
  const LiveModel* model_;
  const Clock& clock_;
  Access access_;
  ServedRun home_;  // the only run, or the newest one in the folder
  Chooser chooser_;
  std::map<std::string, ServedRun> chosen_;  // runs in the folder other than home_, by name
  bool armed_ = false;
  HostTime begun_{}, last_live_{};
};

// Listens on the address given by --listen. Without --listen, uses the loopback interface and the
// first free of ten ports, or any free port if all ten are in use.
void Server::Impl::listen() {
  const bool stated = !options_.listen.empty();
  tcp::endpoint at = stated ? endpoint_of(options_.listen)
                            : tcp::endpoint(net::ip::address_v4::loopback(), usual_port);
  for (int tries = stated ? 1 : usual_ports + 1;; --tries) {
    Error_code error;
    acceptor_.open(at.protocol(), error);
    if (!error) acceptor_.set_option(tcp::acceptor::reuse_address(true), error);
    if (!error) acceptor_.bind(at, error);
    if (!error) acceptor_.listen(net::socket_base::max_listen_connections, error);
    if (!error) return;
    if (tries == 1)
      throw Error(ExitCode::failed, "cannot listen on " + at.address().to_string() + ":" +
                                        std::to_string(at.port()) + ": " + error.message());
    acceptor_.close();
    at.port(tries > 2 ? static_cast<unsigned short>(at.port() + 1) : 0);
  }
}

// Accepts connections. Closes a connection immediately if the limit is reached. Pauses after an
// error, e.g. too many open files.
void Server::Impl::accept() {
  acceptor_.async_accept([this](Error_code error, tcp::socket socket) {
    if (error == net::error::operation_aborted) return;
    if (!error && open_ < max_connections)
      guarded([&] {
        Error_code none;
        socket.set_option(net::socket_base::send_buffer_size(256 << 10), none);
        socket.set_option(tcp::no_delay(true), none);
        std::make_shared<Session>(std::move(socket), *this, open_)->start();
      });
    if (!error) return accept();
    retry_.expires_after(longest_pause);
    retry_.async_wait([this](Error_code) { accept(); });
  });
}

void Server::Impl::pulse() {
  bool ends = interrupted();
  guarded([&] { ends = ends || over(); });
  if (ends) return io_.stop();
  pulse_.expires_after(pulse_pause);
  pulse_.async_wait([this](Error_code) { pulse(); });
}

bool Server::Impl::over() {
  if (!options_.until_closed) return false;
  const HostTime now = clock_.now();
  if (home_.sessions.empty()) home_.run.refresh();
  if (home_.run.live() && home_.run.trouble().empty()) last_live_ = now;
  bool has_clients = false;
  each([&](ServedRun&) { has_clients = true; });
  if (has_clients) return false;
  return last_live_.count() == 0 ? seconds(now - begun_) > start_wait_s
                                 : seconds(now - last_live_) > end_wait_s;
}

void Server::Impl::opened(const std::shared_ptr<Session>& session) {
  if (const std::string& name = session->run(); !name.empty() && !chosen_.contains(name))
    chosen_.try_emplace(name, chooser_.path_of(name), model_, std::nullopt, clock_);
  ServedRun& served = served_run(*session);
  served.sessions.insert(session);
  served.run.refresh();
  if (served.sessions.size() == 1) served.edition = served.run.edition();
  greet(served, *session);
  if (!armed_) arm();
}

// Deletes the state of a run when the last browser that displays the run disconnects.
void Server::Impl::closed(const std::shared_ptr<Session>& session) {
  if (!session->run().empty() && !chosen_.contains(session->run())) return;
  ServedRun& served = served_run(*session);
  served.sessions.erase(session);
  if (served.sessions.empty()) chosen_.erase(session->run());
}

ServedRun& Server::Impl::served_run(const Session& session) {
  return session.run().empty() ? home_ : chosen_.at(session.run());
}

template <class Action>
void Server::Impl::each(Action action) {
  if (!home_.sessions.empty()) action(home_);
  for (auto& [name, served] : chosen_) action(served);
}

template <class Make>
Message Server::Impl::attempt(Make make) {
  try {
    return make();
  } catch (const std::exception& e) {
    return trouble(printable(e.what(), 300));
  }
}

Message Server::Impl::newest(ServedRun& served) {
  const auto last = served.run.last();
  return last ? attempt([&] { return served.messages.record(*last, true); }) : nullptr;
}

void Server::Impl::greet(ServedRun& served, Session& session) {
  if (const std::string& why = served.run.trouble(); !why.empty())
    return session.send(MessageKind::trouble, trouble(why));
  session.send(MessageKind::run,
               attempt([&] { return served.messages.about_run(session.may_write()); }));
  session.send(MessageKind::state, attempt([&] { return served.messages.state(); }));
  session.send(MessageKind::reference, attempt([&] { return served.messages.reference(); }));
  session.send(MessageKind::strip, attempt([&] { return served.messages.strip(); }));
  if (session.live) send_record(served, session, newest(served));
}

// Sends a record. If the session has requested a sum, also sends the sum of the records up to this
// one.
void Server::Impl::send_record(ServedRun& served, Session& session, const Message& record) {
  session.send(MessageKind::record, record);
  if (session.summed) session.send(MessageKind::sum, sum(served, session));
}

Message Server::Impl::sum(ServedRun& served, const Session& session) {
  const auto index = session.live ? served.run.last() : session.held;
  if (!session.summed || !index) return nullptr;
  return attempt([&] { return served.messages.sum(*index, *session.summed); });
}

void Server::Impl::arm() {
  armed_ = true;
  std::chrono::nanoseconds pause = longest_pause;
  each([&](ServedRun& served) {
    pause = std::min(pause, from_seconds(served.run.info().window_s / 4));
  });
  update_timer_.expires_after(std::max<std::chrono::nanoseconds>(pause, shortest_pause));
  update_timer_.async_wait([this](Error_code) {
    armed_ = false;
    bool has_clients = false;
    each([&](ServedRun& served) {
      has_clients = true;
      guarded([&] { update(served); });
    });
    if (has_clients) arm();
  });
}

void Server::Impl::update(ServedRun& served) {
  const bool news = served.run.refresh();
  const std::string& why = served.run.trouble();
  if (!why.empty()) {
    if (is_due(served.state, state_pause_s) || news)
      for (const auto& s : served.sessions) s->send(MessageKind::trouble, trouble(why));
    return;
  }
  if (std::exchange(served.edition, served.run.edition()) != served.run.edition()) {
    served.has_reference = false;
    for (const auto& s : served.sessions) greet(served, *s);
    return;
  }
  send_updates(served, news);
}

void Server::Impl::send_updates(ServedRun& served, bool news) {
  if (is_due(served.state, state_pause_s) || news) {
    const Message state = attempt([&] { return served.messages.state(); });
    for (const auto& s : served.sessions) s->send(MessageKind::state, state);
  }
  if (!news) return;
  const bool any_live =
      std::any_of(served.sessions.begin(), served.sessions.end(), [](auto& s) { return s->live; });
  if (const Message record = any_live ? newest(served) : nullptr)
    for (const auto& s : served.sessions)
      if (s->live) send_record(served, *s, record);
  if (!is_due(served.strip, strip_pause_s)) return;
  const Message strip = attempt([&] { return served.messages.strip(); });
  for (const auto& s : served.sessions) s->send(MessageKind::strip, strip);
  if (served.has_reference) return;
  const Message reference = attempt([&] { return served.messages.reference(); });
  served.has_reference = reference != nullptr;
  for (const auto& s : served.sessions) s->send(MessageKind::reference, reference);
}

Message Server::Impl::answer_to(Session& session, const Request& request) {
  if (const auto* bad = std::get_if<BadRequest>(&request)) return answer(false, bad->why);
  if (const auto* m = std::get_if<Mark>(&request)) return mark(session, *m);
  ServedRun& served = served_run(session);
  return attempt([&]() -> Message {
    if (const auto* requested = std::get_if<ShowSheet>(&request))
      return served.messages.sheet(requested->first, requested->last);
    if (const auto* requested = std::get_if<ShowSum>(&request)) {
      session.summed = *requested;
      return sum(served, session);
    }
    const auto* requested = std::get_if<ShowRecord>(&request);
    session.live = !requested;
    if (requested) session.held = requested->index;
    const Message record =
        requested ? served.messages.record(requested->index, false) : newest(served);
    if (session.summed) session.send(MessageKind::sum, sum(served, session));
    return record;
  });
}

Message Server::Impl::mark(const Session& session, const Mark& mark) {
  if (!session.may_write())
    return answer(false, "marking needs the token: open the full address printed by the program");
  ServedRun& served = served_run(session);
  const std::string& run = served.run.path();
  try {
    if (mark.label) {
      record::put_label(run, mark.text, "view");
      return answer(true, "label set: " + mark.text);
    }
    if (!served.run.live())
      return answer(false, "this run is not being recorded; only a live run can be marked");
    record::put_note(run, mark.text, "view");
    return answer(true, "marked: " + mark.text);
  } catch (const std::exception& e) {
    return answer(false, printable(e.what(), 300));
  }
}

Server::Server(const ServerOptions& options, const LiveModel* model, const Clock& clock)
    : impl_(std::make_unique<Impl>(options, model, clock)) {}
Server::~Server() = default;
std::string Server::address() const { return impl_->address(); }
std::string Server::missing() { return impl_->missing(); }
void Server::run() { impl_->run(); }

}  // namespace echofuse::view
