// SPDX-License-Identifier: MIT
// Driver to copy for a time tagger with a C library: an imaginary one. To record with yours:
//   1. copy example_tagger.* to drivers/tdc/ and rename the class; call your library in
//   VendorBoard;
//   2. add the source to drivers/tdc/CMakeLists.txt, and your library to its links;
//   3. add an address to drivers/port/address.hpp, and its line to drivers/make_driver.cpp;
//   4. `echofuse-acquire devices` shows the device, `run` records it.
#pragma once
#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "drivers/core/driver.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::examples {

// Calls of the vendor's library.
struct VendorBoard {
  std::function<bool()> open;                                        // false: not attached
  std::function<bool(std::vector<Tag>&, std::uint64_t& lost)> read;  // false: unplugged
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
  std::chrono::milliseconds pause_{};  // before the next attempt to connect
  std::vector<Tag> tags_;
  std::uint64_t items_ = 0, lost_ = 0, reconnects_ = 0;
  port::Timer timer_;  // last: its action must not outlive the members above
};

}  // namespace echofuse::examples
