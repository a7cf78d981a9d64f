// SPDX-License-Identifier: MIT
// Byte stream in both directions over any transport: serial line, TCP, USB, HID bridge.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "drivers/core/bytes.hpp"
#include "drivers/core/result.hpp"

namespace boost::asio {
class io_context;
}

namespace echofuse::port {

struct PortHandlers {
  std::function<void()> opened;
  std::function<void(ByteView)> bytes;  // the view is valid only during the call
  // The port could not be opened, or failed: end of file, unplugged, refused. Called at most once;
  // no handler is called after it.
  std::function<void(const Failure&)> gone;
  // Reports a fault after which the port continues; may be empty. Each kind of fault has a constant
  // text. `losses` counts the lost bytes or events.
  std::function<void(const std::string& text, std::uint64_t losses)> warning{};
};

// Single-use connection; to reconnect, create another port. Threading: all calls on the loop's
// thread. Handlers are called from the loop, never inside open() or write(). The destructor closes
// the port. No handler is called after it, and a handler may destroy its own port.
class BytePort {
 public:
  virtual ~BytePort() = default;
  virtual void open(PortHandlers handlers) = 0;
  // Queues bytes and sends them in order. Drops bytes written before `opened` or after `gone`.
  virtual void write(ByteView bytes) = 0;
};

// Creates a driver's port for each connection.
using ByteOpener = std::function<std::unique_ptr<BytePort>()>;

}  // namespace echofuse::port
