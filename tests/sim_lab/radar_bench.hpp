// SPDX-License-Identifier: MIT
// The radar driver on two wires in memory, with the simulated firmware at their other end: every
// byte is where the test put it, and nothing is lost but what the test takes away.
#pragma once
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/core/clock.hpp"
#include "drivers/radar/radar_driver.hpp"
#include "sim/devices/radar_firmware.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::test {

// What the driver's port of one address connects to, again and again.
class Wire {
 public:
  Wire(boost::asio::io_context& io, std::function<void(ByteView)> to_board)
      : io_(io), to_board_(std::move(to_board)) {}

  port::ByteOpener opener() {
    return [this] { return std::make_unique<Port>(*this); };
  }
  // To the host, in one read; lost if it does not listen.
  void send(ByteView bytes) {
    if (choked && !bytes.empty()) bytes = bytes.first(1);
    later([bytes = Bytes(bytes.begin(), bytes.end())](Link& link) {
      if (link.open) link.handlers.bytes(bytes);
    });
  }
  void send(const std::string& text) {
    send(ByteView{reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }
  void plug(bool in) {
    plugged_ = in;
    if (!in) later([](Link& link) { link.fail("read"); });
  }
  bool choked = false;  // only the first byte of each piece comes through

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
      boost::asio::post(wire.io_, [&w = wire, copy = Bytes(bytes.begin(), bytes.end())] {
        if (w.plugged_) w.to_board_(copy);
      });
    }
    Wire& wire;
    std::shared_ptr<Link> link = std::make_shared<Link>();
  };

  template <class Action>
  void later(Action action) {
    boost::asio::post(io_, [action, link = link_] {
      if (link && !link->closed) action(*link);
    });
  }

  boost::asio::io_context& io_;
  std::function<void(ByteView)> to_board_;
  std::shared_ptr<Link> link_;
  bool plugged_ = true;
};

// The firmware, which completes a stop as soon as it is asked for, and sends frames when told.
class RadarBoard {
 public:
  explicit RadarBoard(boost::asio::io_context& io)
      : cli(io,
            [this](ByteView bytes) {
              for (const std::uint8_t byte : bytes) note(static_cast<char>(byte));
              firmware_->receive(bytes);
              firmware_->between_frames();
            }),
        data(io, [](ByteView) {}) {
    power_up();
  }

  // A reset or a power cycle: what it was told is forgotten.
  void power_up() {
    firmware_.emplace([this](const std::string& text) { cli.send(text); },
                      [this](const std::string& raw) { data.send(raw); });
    number = 0;
    firmware_->boot();
  }
  void say(const std::string& text) { firmware_->say(text); }
  bool running() const { return firmware_->running().has_value(); }
  // The next frame, with 64 bins, stats and temperature; 256 bytes.
  Bytes frame() {
    ++number;
    std::vector<std::uint16_t> codes(64);
    for (std::size_t i = 0; i < codes.size(); ++i)
      codes[i] = static_cast<std::uint16_t>(3000 + number % 500 + i);
    return sim::radar_frame(
        {number, number * 10'000'000, 0},
        {sim::range_profile_tlv(codes), sim::stats_tlv({}), sim::temperature_tlv({})}, rng_);
  }
  // What the host said since the last call, without bare lines.
  std::vector<std::string> heard() { return std::exchange(lines_, {}); }
  std::size_t lines_heard() const { return lines_.size(); }

  Wire cli, data;
  std::uint32_t number = 0;

 private:
  void note(char c) {
    if (c != '\n')
      line_ += c;
    else if (!line_.empty())
      lines_.push_back(std::exchange(line_, {}));
  }
  std::optional<sim::RadarFirmware> firmware_;
  std::string line_;
  std::vector<std::string> lines_;
  Rng rng_ = make_rng(1, 1);
};

}  // namespace echofuse::test
