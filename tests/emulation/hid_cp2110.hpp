// SPDX-License-Identifier: MIT
// CP2110 on an emulated USB bus. Programs under umockdev's preload library find it in /sys and open
// /dev/hidrawN with any library. Reports, lost bytes and an unplug behave as with the kernel, at
// one packet per millisecond.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "drivers/core/bytes.hpp"

namespace echofuse::sim {

class UsbBed;

struct HidOptions {
  unsigned number = 0;  // node number: /dev/hidraw<number>
  std::string serial = "0001";
};

// Threading: any thread. `transmit` is called on the testbed's thread, and must not call this
// object.
class HidCp2110 {
 public:
  // Plugs the device in. `transmit` receives the host's UART bytes. `bed` must outlive this object,
  // and supports one device per number. Throws Error(failed).
  HidCp2110(UsbBed& bed, HidOptions options, std::function<void(ByteView)> transmit);
  ~HidCp2110();
  HidCp2110(const HidCp2110&) = delete;
  HidCp2110& operator=(const HidCp2110&) = delete;

  void unplug();
  void plug();
  // Delivers bytes on the UART line. Returns how many fitted (buffer 480 bytes; a report drains 63
  // per ms).
  std::size_t receive(ByteView bytes);
  // Sends a raw report that bypasses the bridge, for faults.
  void raw_input(ByteView report);

  std::uint32_t baud() const;
  Bytes config() const;                // last configuration report
  bool on() const;                     // the UART is enabled
  std::size_t host_waiting() const;    // report bytes not yet read by the host
  std::uint64_t host_dropped() const;  // reports dropped because the host's buffer of 64 was full
  std::uint64_t output_reports() const;
  std::uint64_t opened() const;  // number of opens of the node

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace echofuse::sim
