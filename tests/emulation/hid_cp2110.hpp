// SPDX-License-Identifier: MIT
// A CP2110 on an emulated USB bus: programs below umockdev's preload library find it in /sys, open
// /dev/hidrawN with whatever library they like, and see feature and data reports, a packet a
// millisecond, lost bytes and an unplug as from the kernel.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "drivers/core/bytes.hpp"

namespace echofuse::sim {

class UsbBed;

struct HidOptions {
  unsigned number = 0;  // the node's: /dev/hidraw<number>; one device each
  std::string serial = "0001";
};

// Threading: safe from any thread. `transmit` is called from the testbed's thread, and must not
// call back.
class HidCp2110 {
 public:
  // Plugged in when made. `transmit` gets what the host sends over the UART. `bed` must outlive
  // this, and makes one device of a number in its life. Throws Error(failed).
  HidCp2110(UsbBed& bed, HidOptions options, std::function<void(ByteView)> transmit);
  ~HidCp2110();
  HidCp2110(const HidCp2110&) = delete;
  HidCp2110& operator=(const HidCp2110&) = delete;

  void unplug();
  void plug();
  // Bytes on the UART's wire: how many the bridge had room for (480, a report drains 63 a ms).
  std::size_t receive(ByteView bytes);
  // A report as it is, past the bridge: for what a broken one might send.
  void raw_input(ByteView report);

  std::uint32_t baud() const;
  Bytes config() const;                // the last configuration report
  bool on() const;                     // the UART is enabled
  std::size_t host_waiting() const;    // bytes of reports that the host did not yet read
  std::uint64_t host_dropped() const;  // reports that found the host's buffer of 64 full
  std::uint64_t output_reports() const;
  std::uint64_t opened() const;  // how often programs opened the node

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace echofuse::sim
