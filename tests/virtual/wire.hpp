// SPDX-License-Identifier: MIT
// Connections in memory: a plain byte stream, and a listener for the clients of a bridge.
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "drivers/port/loop.hpp"
#include "sim/devices/listener.hpp"

namespace echofuse::test {

// Board side of the ports of one address. The board can be unplugged and plugged in again.
class Wire {
 public:
  Wire(port::Loop& loop, std::function<void(ByteView)> to_board)
      : loop_(loop), to_board_(std::move(to_board)) {}

  port::ByteOpener opener() {
    return [this] { return std::make_unique<Port>(*this); };
  }
  // Sends bytes to the host, which receives them in a single read. The bytes are lost if the host
  // is not reading.
  void send(ByteView bytes) {
    if (!cut) deliver(bytes);
  }
  // Sends bytes even if the wire is cut, as if a second board were on the same wire.
  void noise(const std::string& text) {
    deliver(ByteView{reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }
  void deliver(ByteView bytes) {
    if (choked && !bytes.empty()) bytes = bytes.first(1);
    later([bytes = Bytes(bytes.begin(), bytes.end())](Link& link) {
      if (link.open) link.handlers.bytes(bytes);
    });
  }
  void send(const std::string& text) {
    send(ByteView{reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }
  bool connected() const { return plugged_ && link_ && link_->open; }
  void plug(bool in) {
    if (std::exchange(plugged_, in) == in) return;
    if (!in) later([](Link& link) { link.fail("read"); });
  }
  bool cut = false;     // true if all bytes sent by the board are dropped
  bool choked = false;  // true if only the first byte of each piece sent is passed on

 private:
  struct Link {
    port::PortHandlers handlers;
    bool open = false, closed = false;
    void fail(const char* doing) {
      if (std::exchange(closed, true)) return;
      open = false;
      handlers.gone({std::make_error_code(std::errc::no_such_device), doing});
    }
  };
  struct Port final : port::BytePort {
    explicit Port(Wire& w) : wire(w) {}
    ~Port() override { link->open = false, link->closed = true; }
    void open(port::PortHandlers handlers) override {
      link->handlers = std::move(handlers);
      wire.link_ = link;
      wire.later([&w = wire](Link& l) {
        if (!w.plugged_) return l.fail("open");
        l.open = true;
        l.handlers.opened();
      });
    }
    void write(ByteView bytes) override {
      if (!link->open || bytes.empty()) return;
      wire.loop_.post([&w = wire, copy = Bytes(bytes.begin(), bytes.end())] {
        if (w.plugged_) w.to_board_(copy);
      });
    }
    Wire& wire;
    std::shared_ptr<Link> link = std::make_shared<Link>();
  };

  template <class Action>
  void later(Action action) {
    loop_.post([action, link = link_] {
      if (link && !link->closed) action(*link);
    });
  }

  port::Loop& loop_;
  std::function<void(ByteView)> to_board_;
  std::shared_ptr<Link> link_;
  bool plugged_ = true;
};

// Bridge side of a wire. The bridge serves one client at a time while other clients wait.
class MemoryListener final : public sim::Listener {
 public:
  explicit MemoryListener(port::Loop& loop) : loop_(loop) {}

  // Returns the function that the driver calls to open its port. The listener must outlive all
  // ports.
  port::ByteOpener opener() {
    return [this] { return std::make_unique<Port>(*this); };
  }

  void start(Handlers handlers) override { handlers_ = std::move(handlers); }
  void accept() override {
    wanted_ = true;
    serve();
  }
  void plug(bool in) override { plugged_ = in; }
  bool plugged() const override { return plugged_; }
  void write(ByteView bytes, std::function<void(bool)> done) override {
    loop_.post([to = client_, bytes, done = std::move(done)] {
      const bool whole = to && !to->closed;
      if (whole) to->handlers.bytes(bytes);
      done(whole);
    });
  }
  void hang_up() override {
    if (!client_) return;
    loop_.post([link = client_] { link->fail("End of file: read"); });
    client_.reset();
  }
  std::string address() const override { return "memory"; }

 private:
  struct Link {
    port::PortHandlers handlers;
    bool closed = false;
    void fail(const char* why) {
      if (!std::exchange(closed, true))
        handlers.gone({std::make_error_code(std::errc::connection_reset), why});
    }
  };
  struct Port final : port::BytePort {
    explicit Port(MemoryListener& l) : listener(l) {}
    ~Port() override {
      link->closed = true;
      std::erase(listener.waiting_, link);
      if (listener.client_ != link) return;
      listener.client_.reset();
      listener.loop_.post([&l = listener] { l.handlers_.left(); });
    }
    void open(port::PortHandlers handlers) override {
      link->handlers = std::move(handlers);
      listener.loop_.post([&l = listener, link = link] {
        if (link->closed) return;
        if (!l.plugged_) return link->fail("connect");
        l.waiting_.push_back(link);
        link->handlers.opened();
        l.serve();
      });
    }
    void write(ByteView) override {}  // a bridge's client sends nothing
    MemoryListener& listener;
    std::shared_ptr<Link> link = std::make_shared<Link>();
  };
  void serve() {
    if (!wanted_ || client_ || waiting_.empty()) return;
    wanted_ = false;
    client_ = waiting_.front();
    waiting_.erase(waiting_.begin());
    loop_.post([this, link = client_] {
      if (client_ == link) handlers_.connected();
    });
  }

  port::Loop& loop_;
  Handlers handlers_;
  std::shared_ptr<Link> client_;
  std::vector<std::shared_ptr<Link>> waiting_;
  bool plugged_ = true, wanted_ = false;
};

}  // namespace echofuse::test
