// SPDX-License-Identifier: MIT
// Example driver for an imaginary time tagger with a C library. To support your own tagger:
//   1. Copy example_tagger.* to drivers/tdc/, rename the class, and call your library there. If the
//      library must be linked, add it to drivers/tdc/CMakeLists.txt.
//   2. Add a row with the scheme of its address, e.g. "example:", to drivers/make_driver.cpp.
//   3. Check that `echofuse-acquire devices` lists the device. `run` then records it.
#pragma once
#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "drivers/core/driver.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::examples {

// Functions of the vendor's library that the driver calls. Each returns false if the board is not
// available.
struct VendorBoard {
  // returns false if the board is not attached
  std::function<bool()> open;
  // returns false if the board has been unplugged
  std::function<bool(std::vector<Tag>&, std::uint64_t& lost)> read;
};

class ExampleTagger final : public Driver {
 public:
  ExampleTagger(port::Loop& loop, VendorBoard board, std::string address);
  void start(SampleSink& sink) override;
  void stop() override { timer_.cancel(); }
  std::vector<Counter> counters() const override;

 private:
  void connect();
  void poll();

  port::Loop& loop_;
  VendorBoard board_;
  DeviceInfo info_;
  SampleSink* sink_ = nullptr;
  std::chrono::milliseconds pause_{};  // pause before the next attempt to connect
  std::vector<Tag> tags_;
  std::uint64_t items_ = 0, lost_ = 0, reconnects_ = 0;
  // Declared last, so that it is destroyed before the members that its action uses.
  port::Timer timer_;
};

}  // namespace echofuse::examples
