// SPDX-License-Identifier: MIT
// Listening socket that a device's clients connect to, one at a time.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "drivers/core/bytes.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::sim {

// Threading: the loop's thread. Handlers are called from the loop.
class Listener {
 public:
  struct Handlers {
    port::Action connected;
    port::Action left;  // the client closed the connection
  };
  virtual ~Listener() = default;
  virtual void start(Handlers handlers) = 0;
  // Ends this client's connection; accept() must be called again for the next.
  virtual void accept() = 0;
  // While unplugged, clients cannot connect. A connected client stays connected.
  virtual void plug(bool in) = 0;
  virtual bool plugged() const = 0;
  // Only one write at a time. `bytes` must live until `done(whole)`; whole: all were written.
  virtual void write(ByteView bytes, std::function<void(bool whole)> done) = 0;
  virtual void hang_up() = 0;
  virtual std::string address() const = 0;
};

// Listens on 127.0.0.1; port 0 takes any free port. Address: "bridge:tcp://127.0.0.1:PORT".
std::unique_ptr<Listener> make_tcp_listener(port::SystemLoop& loop, std::uint16_t port);

}  // namespace echofuse::sim
