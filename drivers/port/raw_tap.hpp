// SPDX-License-Identifier: MIT
// The bytes of devices as they came, kept in files beside a run, so that `import` can make the run
// of them again. NAME.times tells of a port when it did what, a line each, "HOST_NS WHAT VALUE":
//   open 0      the driver wants a connection; all up to the next "open" is of that one
//   opened 0    the port is open
//   bytes N     the next N bytes of the connection's file came
//   gone ERRNO  the port is no longer there
#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "drivers/core/bytes.hpp"
#include "drivers/port/byte_port.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::port {

struct RawLimits {
  std::size_t queue_bytes = 64u << 20;     // that wait for the disk; more are dropped, and counted
  std::uint64_t reserve_bytes = 1u << 30;  // left free on the disk for the run
};

// Threading: put(), take_trouble() and finish() from any thread; none of them waits for the disk,
// but finish(). The worker writes. The first failure (a full disk, a removed folder) ends
// the keeping, and nothing else.
class RawKeeper {
 public:
  // The folder is made; Throws Error(usage) if there is something in it, Error(disk) if it cannot
  // be made.
  RawKeeper(std::string folder, std::unique_ptr<Worker> worker, RawLimits limits = {});
  ~RawKeeper();
  RawKeeper(const RawKeeper&) = delete;
  RawKeeper& operator=(const RawKeeper&) = delete;

  // Appends to FOLDER/NAME, which is made with its first bytes. False: the bytes are dropped.
  bool put(const std::string& name, ByteView bytes);
  void put_text(const std::string& name, const std::string& text);
  // Adds a line to FOLDER/NAME.times.
  void note(const std::string& name, HostTime at, const char* what, std::int64_t value = 0);
  // The next file of this device: NAME-001.dat with the ending ".dat"; one for each connection.
  std::string next_name(const std::string& name, const std::string& ending);
  // Returns once why nothing is kept any more; empty if all is well.
  std::string take_trouble();
  struct Counts {
    std::uint64_t kept = 0, dropped = 0;  // bytes
  };
  // Writes what waits, for at most 2 s; nothing is kept after that.
  Counts finish();

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;
  std::unique_ptr<Worker> worker_;
};

// The opener's ports, but each puts what it receives into a file of next_name() as well, with the
// time that its driver sees. Without a keeper: the opener itself. `loop` and `keeper` must outlive
// the ports.
ByteOpener tap(Loop& loop, ByteOpener opener, RawKeeper* keeper, std::string name,
               std::string ending);

}  // namespace echofuse::port
