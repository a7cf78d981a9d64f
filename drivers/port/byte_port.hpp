// SPDX-License-Identifier: MIT
// A stream of bytes in both directions, whatever carries it: serial line, TCP, USB, HID bridge.
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
  // Could not be opened, or is no longer there: end of file, unplugged, refused are all the same to
  // a driver. At most once, and nothing follows it.
  std::function<void(const Failure&)> gone;
  // Warning that something is wrong while the port goes on; may be empty. The text does not vary
  // from call to call. `losses`: number of bytes or events lost on the way; 0 if none were.
  std::function<void(const std::string& text, std::uint64_t losses)> warning{};
};

// Connection that opens once; to reconnect, make another port. Threading: everything on the loop's
// thread. Handlers are called from the loop, never from inside open() or write(). Destroying the
// port closes it: no handler is called after that, and a handler may destroy its own port.
class BytePort {
 public:
  virtual ~BytePort() = default;
  virtual void open(PortHandlers handlers) = 0;
  // Queued and sent in order; bytes written before `opened` or after `gone` are dropped.
  virtual void write(ByteView bytes) = 0;
};

// Makes a driver's port, each time it connects.
using ByteOpener = std::function<std::unique_ptr<BytePort>()>;

}  // namespace echofuse::port
