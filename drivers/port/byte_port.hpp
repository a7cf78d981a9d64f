// SPDX-License-Identifier: MIT
// Two-way byte stream over any transport: serial port, TCP, USB or HID bridge.
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
  std::function<void(ByteView)> bytes;  // the bytes are valid only during the call
  // Called if the port cannot be opened or fails (end of file, device unplugged, connection
  // refused). It is called at most once, and no handler is called after it.
  std::function<void(const Failure&)> gone;
  // Reports a fault that does not close the port. The handler may be empty. `text` is the same for
  // all faults of one kind. `losses` is the number of lost bytes or events.
  std::function<void(const std::string& text, std::uint64_t losses)> warning{};
};

// A connection that can be opened only once; to reconnect, create another port. Threading: call all
// functions from the loop's thread. Handlers are called by the loop, never inside open() or
// write(). The destructor closes the port, and no handler is called after it. A handler may destroy
// its own port.
class BytePort {
 public:
  virtual ~BytePort() = default;
  virtual void open(PortHandlers handlers) = 0;
  // Queues the bytes and sends them in order. Discards bytes written before `opened` or after
  // `gone` is called.
  virtual void write(ByteView bytes) = 0;
  // Returns true if the bytes are from a file, and a damaged block did not end their connection
  // when they were recorded. Intact blocks may then follow a damaged one.
  virtual bool recorded() const { return false; }
};

// Creates a port. A driver calls this function for each new connection.
using ByteOpener = std::function<std::unique_ptr<BytePort>()>;

}  // namespace echofuse::port
