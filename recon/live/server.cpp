// SPDX-License-Identifier: MIT
#include "recon/live/server.hpp"

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
constexpr double last_look_s = 5;    // until_closed: wait after the run's end
constexpr double first_look_s = 60;  // until_closed: wait for a run to start

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

// A run with connected browsers.
struct ServedRun {
  ServedRun(const std::string& target, const LiveModel* model, std::optional<std::int64_t> planned,
            const Clock& clock)
      : run(target), show(run, model, planned, clock) {}
  FollowedRun run;
  RunMessages show;
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
    access_.token_asked = !access_.loopback;
    access_.host_name = machine_name();
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
    const bool any = at.address().is_unspecified();
    const std::string host = any                    ? access_.host_name
                             : at.address().is_v6() ? "[" + at.address().to_string() + "]"
                                                    : at.address().to_string();
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
  Message sum(ServedRun& shown, const Session& session);

  void listen();
  void accept();
  void pulse();
  bool over();
  void arm();
  void look(ServedRun& shown);
  void tell_all(ServedRun& shown, bool news);
  // True once in `pause_s`.
  bool is_due(HostTime& last, double pause_s) const {
    const HostTime now = clock_.now();
    return seconds(now - last) >= pause_s && (last = now, true);
  }
  void greet(ServedRun& shown, Session& session);
  Message newest(ServedRun& shown);
  void send_record(ServedRun& shown, Session& session, const Message& record);
  ServedRun& shown_to(const Session& session);
  // Calls look(shown) for each run with connected browsers.
  template <class Action>
  void each(Action look);
  template <class Make>
  Message attempt(Make make);

  int open_ = 0;  // connections; declared first because sessions in io_ decrement it when destroyed
  net::io_context io_;  // destroyed after its users below
  tcp::acceptor acceptor_{io_};
  net::steady_timer pulse_{io_}, look_{io_}, retry_{io_};
  const ServerOptions options_;
  const LiveModel* model_;
  const Clock& clock_;
  Access access_;
  ServedRun home_;  // the only run, or the folder's newest
  Chooser chooser_;
  std::map<std::string, ServedRun> chosen_;  // by name
  bool armed_ = false;
  HostTime begun_{}, seen_live_{};
};

// Takes --listen if given, otherwise the first free port of ten, otherwise any.
void Server::Impl::listen() {
  const bool said = !options_.listen.empty();
  tcp::endpoint at = said ? endpoint_of(options_.listen)
                          : tcp::endpoint(net::ip::address_v4::loopback(), usual_port);
  for (int tries = said ? 1 : usual_ports + 1;; --tries) {
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

// Closes a connection above the limit at once. Waits after an error such as too many open files.
void Server::Impl::accept() {
  acceptor_.async_accept([this](Error_code error, tcp::socket socket) {
    if (error == net::error::operation_aborted) return;
    if (!error && open_ < most_connections)
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
  if (home_.run.live() && home_.run.trouble().empty()) seen_live_ = now;
  bool looked_at = false;
  each([&](ServedRun&) { looked_at = true; });
  if (looked_at) return false;
  return seen_live_.count() == 0 ? seconds(now - begun_) > first_look_s
                                 : seconds(now - seen_live_) > last_look_s;
}

void Server::Impl::opened(const std::shared_ptr<Session>& session) {
  if (const std::string& name = session->run(); !name.empty() && !chosen_.contains(name))
    chosen_.try_emplace(name, chooser_.path_of(name), model_, std::nullopt, clock_);
  ServedRun& shown = shown_to(*session);
  shown.sessions.insert(session);
  shown.run.refresh();
  if (shown.sessions.size() == 1) shown.edition = shown.run.edition();
  greet(shown, *session);
  if (!armed_) arm();
}

// Frees the state of a run when its last browser disconnects.
void Server::Impl::closed(const std::shared_ptr<Session>& session) {
  if (!session->run().empty() && !chosen_.contains(session->run())) return;
  ServedRun& shown = shown_to(*session);
  shown.sessions.erase(session);
  if (shown.sessions.empty()) chosen_.erase(session->run());
}

ServedRun& Server::Impl::shown_to(const Session& session) {
  return session.run().empty() ? home_ : chosen_.at(session.run());
}

template <class Action>
void Server::Impl::each(Action look) {
  if (!home_.sessions.empty()) look(home_);
  for (auto& [name, shown] : chosen_) look(shown);
}

template <class Make>
Message Server::Impl::attempt(Make make) {
  try {
    return make();
  } catch (const std::exception& e) {
    return trouble(printable(e.what(), 300));
  }
}

Message Server::Impl::newest(ServedRun& shown) {
  const auto last = shown.run.last();
  return last ? attempt([&] { return shown.show.record(*last, true); }) : nullptr;
}

void Server::Impl::greet(ServedRun& shown, Session& session) {
  if (const std::string& why = shown.run.trouble(); !why.empty())
    return session.send(MessageKind::trouble, trouble(why));
  session.send(MessageKind::run,
               attempt([&] { return shown.show.about_run(session.may_write()); }));
  session.send(MessageKind::state, attempt([&] { return shown.show.state(); }));
  session.send(MessageKind::reference, attempt([&] { return shown.show.reference(); }));
  session.send(MessageKind::strip, attempt([&] { return shown.show.strip(); }));
  if (session.live) send_record(shown, session, newest(shown));
}

// Sends a record, and the sum that ends with it if the session wants one.
void Server::Impl::send_record(ServedRun& shown, Session& session, const Message& record) {
  session.send(MessageKind::record, record);
  if (session.summed) session.send(MessageKind::sum, sum(shown, session));
}

Message Server::Impl::sum(ServedRun& shown, const Session& session) {
  const auto index = session.live ? shown.run.last() : session.held;
  if (!session.summed || !index) return nullptr;
  return attempt([&] { return shown.show.sum(*index, *session.summed); });
}

void Server::Impl::arm() {
  armed_ = true;
  std::chrono::nanoseconds pause = longest_pause;
  each([&](ServedRun& shown) {
    pause = std::min(pause, from_seconds(shown.run.info().window_s / 4));
  });
  look_.expires_after(std::max<std::chrono::nanoseconds>(pause, shortest_pause));
  look_.async_wait([this](Error_code) {
    armed_ = false;
    bool looked_at = false;
    each([&](ServedRun& shown) {
      looked_at = true;
      guarded([&] { look(shown); });
    });
    if (looked_at) arm();
  });
}

void Server::Impl::look(ServedRun& shown) {
  const bool news = shown.run.refresh();
  const std::string& why = shown.run.trouble();
  if (!why.empty()) {
    if (is_due(shown.state, state_pause_s) || news)
      for (const auto& s : shown.sessions) s->send(MessageKind::trouble, trouble(why));
    return;
  }
  if (std::exchange(shown.edition, shown.run.edition()) != shown.run.edition()) {
    shown.has_reference = false;
    for (const auto& s : shown.sessions) greet(shown, *s);
    return;
  }
  tell_all(shown, news);
}

void Server::Impl::tell_all(ServedRun& shown, bool news) {
  if (is_due(shown.state, state_pause_s) || news) {
    const Message state = attempt([&] { return shown.show.state(); });
    for (const auto& s : shown.sessions) s->send(MessageKind::state, state);
  }
  if (!news) return;
  const bool wanted =
      std::any_of(shown.sessions.begin(), shown.sessions.end(), [](auto& s) { return s->live; });
  if (const Message record = wanted ? newest(shown) : nullptr)
    for (const auto& s : shown.sessions)
      if (s->live) send_record(shown, *s, record);
  if (!is_due(shown.strip, strip_pause_s)) return;
  const Message strip = attempt([&] { return shown.show.strip(); });
  for (const auto& s : shown.sessions) s->send(MessageKind::strip, strip);
  if (shown.has_reference) return;
  const Message reference = attempt([&] { return shown.show.reference(); });
  shown.has_reference = reference != nullptr;
  for (const auto& s : shown.sessions) s->send(MessageKind::reference, reference);
}

Message Server::Impl::answer_to(Session& session, const Request& request) {
  if (const auto* bad = std::get_if<BadRequest>(&request)) return answer(false, bad->why);
  if (const auto* m = std::get_if<Mark>(&request)) return mark(session, *m);
  ServedRun& shown = shown_to(session);
  return attempt([&]() -> Message {
    if (const auto* asked = std::get_if<ShowSheet>(&request))
      return shown.show.sheet(asked->first, asked->last);
    if (const auto* asked = std::get_if<ShowSum>(&request)) {
      session.summed = *asked;
      return sum(shown, session);
    }
    const auto* asked = std::get_if<ShowRecord>(&request);
    session.live = !asked;
    if (asked) session.held = asked->index;
    const Message record = asked ? shown.show.record(asked->index, false) : newest(shown);
    if (session.summed) session.send(MessageKind::sum, sum(shown, session));
    return record;
  });
}

Message Server::Impl::mark(const Session& session, const Mark& mark) {
  if (!session.may_write())
    return answer(false, "marking needs the token: open the full address printed by the program");
  ServedRun& shown = shown_to(session);
  const std::string& run = shown.run.path();
  try {
    if (mark.label) {
      record::put_label(run, mark.text, "view");
      return answer(true, "label set: " + mark.text);
    }
    if (!shown.run.live())
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
