// SPDX-License-Identifier: MIT
// CP2110 on an emulated USB bus. Programs under umockdev's preload library find it in /sys and open
// /dev/hidrawN with any library. Reports, lost bytes and unplugging behave as with the kernel, at
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
  unsigned number = 0;  // number in the path of the device node, /dev/hidraw<number>
  std::string serial = "0001";
};

// Emulates a CP2110. All functions may be called on any thread. `transmit` is called on the
// testbed's thread and must not call functions of this object.
class HidCp2110 {
 public:
  // Plugs in the device. `transmit` is called with the UART bytes that the host sends. `bed` must
  // outlive this object and supports one device per number. Throws Error(failed).
  HidCp2110(UsbBed& bed, HidOptions options, std::function<void(ByteView)> transmit);
  ~HidCp2110();
  HidCp2110(const HidCp2110&) = delete;
  HidCp2110& operator=(const HidCp2110&) = delete;

  void unplug();
  void plug();
  // Delivers bytes from the UART line. Returns the number of bytes that fit into the 480-byte
  // buffer. The host fetches 63 bytes per ms from this buffer.
  std::size_t receive(ByteView bytes);
  // Sends a raw report to the host. Used to simulate faults, because the report does not come from
  // the UART.
  void raw_input(ByteView report);

  std::uint32_t baud() const;
  Bytes config() const;              // last configuration report sent by the host
  bool on() const;                   // true if the UART is enabled
  std::size_t host_waiting() const;  // number of bytes in reports that the host has not read yet
  // Returns the number of reports dropped because the host's buffer of 64 reports was full.
  std::uint64_t host_dropped() const;
  std::uint64_t output_reports() const;
  std::uint64_t opened() const;  // number of times that the node was opened

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace echofuse::sim
