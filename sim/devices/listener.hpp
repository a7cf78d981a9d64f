// SPDX-License-Identifier: MIT
// Listening end to which a device's clients connect, one at a time.
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
    port::Action left;  // the client went by itself
  };
  virtual ~Listener() = default;
  virtual void start(Handlers handlers) = 0;
  // The next client may come; accept() is called again for the one after it.
  virtual void accept() = 0;
  // While it is not plugged in, nobody can connect. Pulling it out leaves the client connected.
  virtual void plug(bool in) = 0;
  virtual bool plugged() const = 0;
  // One write at a time. `bytes` live until `done`, which says whether all of them went out.
  virtual void write(ByteView bytes, std::function<void(bool whole)> done) = 0;
  virtual void hang_up() = 0;
  virtual std::string address() const = 0;
};

// Listens on 127.0.0.1; port 0 takes any free port. Address: "bridge:tcp://127.0.0.1:PORT".
std::unique_ptr<Listener> make_tcp_listener(port::SystemLoop& loop, std::uint16_t port);

}  // namespace echofuse::sim
