// SPDX-License-Identifier: MIT
// Listening socket of a device. It accepts one client at a time.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "drivers/core/bytes.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::sim {

// Threading: must be used only from the thread of the event loop, which also calls the handlers.
class Listener {
 public:
  struct Handlers {
    port::Action connected;
    port::Action left;  // called when the client closes the connection
  };
  virtual ~Listener() = default;
  virtual void start(Handlers handlers) = 0;
  // Accepts one client, either at once or as soon as one connects. Call again after hang_up() to
  // accept the next client.
  virtual void accept() = 0;
  // Opens or closes the listening socket. While it is closed, clients cannot connect; a connected
  // client stays connected.
  virtual void plug(bool in) = 0;
  virtual bool plugged() const = 0;
  // Writes `bytes`, then calls done(whole); `whole` is true if all bytes were written. `bytes` must
  // stay valid until then. Only one write may be in progress.
  virtual void write(ByteView bytes, std::function<void(bool whole)> done) = 0;
  virtual void hang_up() = 0;
  virtual std::string address() const = 0;
};

// Returns a listener on 127.0.0.1 with the address "bridge:tcp://127.0.0.1:PORT". Port 0 selects
// any free port.
std::unique_ptr<Listener> make_tcp_listener(port::SystemLoop& loop, std::uint16_t port);

}  // namespace echofuse::sim
