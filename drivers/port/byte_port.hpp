// SPDX-License-Identifier: MIT
// A stream of bytes in both directions, whatever carries it: serial line, TCP, later HID.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>

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
};

// One connection; to reconnect, make another port.
// Threading: everything on the io thread. Handlers are called from the io context, never from
// inside open() or write(). Destroying the port closes it: no handler is called after that, and a
// handler may destroy its own port.
class BytePort {
 public:
  virtual ~BytePort() = default;
  virtual void open(PortHandlers handlers) = 0;
  // Queued and sent in order; bytes written before `opened` or after `gone` are dropped.
  virtual void write(ByteView bytes) = 0;
};

// How a driver gets its port, each time it connects.
using ByteOpener = std::function<std::unique_ptr<BytePort>()>;

}  // namespace echofuse::port
