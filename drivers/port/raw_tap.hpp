// SPDX-License-Identifier: MIT
// Raw capture: stores the bytes received from each device in files, so that `import` can repeat the
// run. NAME.times lists the events of the port, one per line, as "HOST_NS WHAT VALUE":
//   open 0      a connection attempt started; it lasts up to the next "open"
//   opened 0    the port was opened
//   bytes N     the next N bytes of the connection's file were received
//   gone ERRNO  the port was closed by an error
#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "drivers/core/bytes.hpp"
#include "drivers/port/byte_port.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::port {

struct RawLimits {
  // maximum size of the queue; further bytes are dropped and counted
  std::size_t queue_bytes = 64u << 20;
  std::uint64_t reserve_bytes = 1u << 30;  // free disk space in bytes that is reserved for the run
};

// Threading: any thread may call put(), take_trouble() and finish(); only finish() waits for the
// disk. The worker writes the files. The first failure (disk full, folder removed) ends the raw
// capture, but not the run.
class RawKeeper {
 public:
  // Creates the folder. Throws Error(usage) if the folder is not empty, and Error(disk) if it
  // cannot be created.
  RawKeeper(std::string folder, std::unique_ptr<Worker> worker, RawLimits limits = {});
  ~RawKeeper();
  RawKeeper(const RawKeeper&) = delete;
  RawKeeper& operator=(const RawKeeper&) = delete;

  // Appends the bytes to the file FOLDER/NAME, which is created if it does not exist. Returns false
  // if the bytes are dropped.
  bool put(const std::string& name, ByteView bytes);
  void put_text(const std::string& name, const std::string& text);
  // Appends a line with the given values to the file FOLDER/NAME.times.
  void note(const std::string& name, HostTime at, const char* what, std::int64_t value = 0);
  // Returns the file name for the next connection of the device, for example NAME-001.dat for the
  // ending ".dat".
  std::string next_name(const std::string& name, const std::string& ending);
  // The first call after the capture has stopped returns the reason; all other calls return an
  // empty string.
  std::string take_trouble();
  struct Counts {
    std::uint64_t kept = 0, dropped = 0;  // number of bytes written and number of bytes dropped
  };
  // Waits up to 2 s for queued bytes to be written, then ends the capture.
  Counts finish();

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;
  std::unique_ptr<Worker> worker_;
};

// Returns an opener of ports that also store the received bytes in files named by next_name().
// NAME.times contains the arrival times that the driver uses. Returns `opener` itself if `keeper`
// is null. `loop` and `keeper` must outlive the ports.
ByteOpener tap(Loop& loop, ByteOpener opener, RawKeeper* keeper, std::string name,
               std::string ending);

}  // namespace echofuse::port
