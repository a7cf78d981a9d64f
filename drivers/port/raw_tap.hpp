// SPDX-License-Identifier: MIT
// Raw capture: stores the received bytes of each device in files, so that `import` can
// repeat the run. NAME.times logs the port's events, one line each, "HOST_NS WHAT VALUE":
//   open 0      start of a connection attempt, up to the next "open"
//   opened 0    the port is open
//   bytes N     the next N bytes of the connection's file were received
//   gone ERRNO  the port was closed
#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "drivers/core/bytes.hpp"
#include "drivers/port/byte_port.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::port {

struct RawLimits {
  std::size_t queue_bytes = 64u << 20;     // queue limit; more bytes are dropped, and counted
  std::uint64_t reserve_bytes = 1u << 30;  // free space reserved for the run
};

// Threading: put(), take_trouble() and finish() from any thread; only finish() waits for the disk.
// The worker writes. The first failure (disk full, folder removed) ends the capture only.
class RawKeeper {
 public:
  // Creates the folder. Throws Error(usage) if it is not empty, Error(disk) if it cannot be
  // created.
  RawKeeper(std::string folder, std::unique_ptr<Worker> worker, RawLimits limits = {});
  ~RawKeeper();
  RawKeeper(const RawKeeper&) = delete;
  RawKeeper& operator=(const RawKeeper&) = delete;

  // Appends to FOLDER/NAME, created with its first bytes. Returns false if the bytes are dropped.
  bool put(const std::string& name, ByteView bytes);
  void put_text(const std::string& name, const std::string& text);
  // Adds a line to FOLDER/NAME.times.
  void note(const std::string& name, HostTime at, const char* what, std::int64_t value = 0);
  // Returns a file name for the device's next connection: NAME-001.dat with the ending ".dat".
  std::string next_name(const std::string& name, const std::string& ending);
  // Returns the reason once after the capture has stopped; otherwise empty.
  std::string take_trouble();
  struct Counts {
    std::uint64_t kept = 0, dropped = 0;  // bytes
  };
  // Writes the queue, for at most 2 s, and ends the capture.
  Counts finish();

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;
  std::unique_ptr<Worker> worker_;
};

// Wraps the opener's ports: each also stores the received bytes in a file of next_name(), with the
// receive time of the driver. Returns the opener itself without a keeper. `loop` and `keeper` must
// outlive the ports.
ByteOpener tap(Loop& loop, ByteOpener opener, RawKeeper* keeper, std::string name,
               std::string ending);

}  // namespace echofuse::port
