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
#include "sim/encode.hpp"

namespace echofuse::test {

// What the driver's ports of one address connect to. Threading: one io thread.
class Wire {
 public:
  Wire(boost::asio::io_context& io, std::function<void(ByteView)> to_board)
      : io_(io), to_board_(std::move(to_board)) {}

  port::ByteOpener opener() {
    return [this] { return std::make_unique<Port>(*this); };
  }
  // To the host, in one read.
  void send(ByteView bytes) {
    later([bytes = Bytes(bytes.begin(), bytes.end())](Port& port) { port.handlers.bytes(bytes); });
  }
  void send(const std::string& text) {
    send(ByteView{reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }
  void plug(bool in) {
    plugged_ = in;
    if (!in) later([](Port& port) { port.gone("read"); });
  }
  bool open() const { return port_ && port_->open_; }

 private:
  struct Port final : port::BytePort {
    explicit Port(Wire& w) : wire(w) {}
    ~Port() override {
      if (wire.port_ == this) wire.port_ = nullptr;
    }
    void open(port::PortHandlers h) override {
      handlers = std::move(h);
      wire.port_ = this;
      wire.later([](Port& port) {
        if (!port.wire.plugged_) return port.gone("open");
        port.open_ = true;
        port.handlers.opened();
      });
    }
    void write(ByteView bytes) override {
      if (!open_) return;
      boost::asio::post(wire.io_, [&w = wire, copy = Bytes(bytes.begin(), bytes.end())] {
        if (w.plugged_) w.to_board_(copy);
      });
    }
    void gone(const char* doing) {
      open_ = false;
      const auto handler = std::exchange(handlers, {}).gone;
      if (handler) handler({std::make_error_code(std::errc::no_such_device), doing});
    }
    Wire& wire;
    port::PortHandlers handlers;
    bool open_ = false;
  };

  template <class Action>
  void later(Action action) {
    boost::asio::post(io_, [this, action, port = port_] {
      if (port && port == port_ && port->handlers.gone) action(*port);
    });
  }

  boost::asio::io_context& io_;
  std::function<void(ByteView)> to_board_;
  Port* port_ = nullptr;
  bool plugged_ = true;
};

// The firmware, which completes a stop as soon as it is asked for, and sends frames when told.
class RadarBoard {
 public:
  explicit RadarBoard(boost::asio::io_context& io)
      : cli(io,
            [this](ByteView bytes) {
              for (const std::uint8_t byte : bytes) note(static_cast<char>(byte));
              if (deaf) return;
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
    return sim::radar_frame({number, number * 10'000'000, 0},
                            {sim::range_profile_tlv(codes), sim::stats_tlv({}),
                             sim::temperature_tlv({})},
                            rng_);
  }
  // What the host said since the last call, without bare lines.
  std::vector<std::string> heard() { return std::exchange(lines_, {}); }

  Wire cli, data;
  std::uint32_t number = 0;
  bool deaf = false;

 private:
  void note(char c) {
    if (c != '\n') {
      line_ += c;
    } else if (!std::exchange(line_, {}).empty()) {
      lines_.push_back(last_);
    }
    last_ = line_;
  }
  std::optional<sim::RadarFirmware> firmware_;
  std::string line_, last_;
  std::vector<std::string> lines_;
  Rng rng_ = make_rng(1, 1);
};

}  // namespace echofuse::test
