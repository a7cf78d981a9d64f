// SPDX-License-Identifier: MIT
// CP2110 on an emulated USB bus. Programs under umockdev's preload library find it in /sys and open
// /dev/hidrawN with any library. Reports, lost bytes and unplugging behave as with the kernel, at
// one packet per millisecond.
#pragma once
#include <condition_variable>
#include <mutex>
#include <thread>

#include "tests/emulation/cp2110_chip.hpp"
#include "tests/emulation/usb_bed.hpp"

namespace echofuse::sim {

struct HidOptions {
  unsigned number = 0;  // number in the path of the device node, /dev/hidraw<number>
  std::string serial = "0001";
};

// Emulates a CP2110. All functions except plug() and unplug() may be called on any thread.
class HidCp2110 final : public BedNode {
 public:
  // Plugs in the device. `transmit` is called on the testbed's thread with the UART bytes that the
  // host sends, and must not call functions of this object. `bed` must outlive this object and
  // supports one device per number. Throws Error(failed).
  HidCp2110(UsbBed& bed, const HidOptions& options, std::function<void(ByteView)> transmit);
  ~HidCp2110() override;

  // Delivers bytes from the UART line. Returns the number of bytes that fit into the 480-byte
  // buffer. The host fetches 63 bytes per ms from this buffer.
  std::size_t receive(ByteView bytes);
  // Sends a raw report to the host. Used to simulate faults, because the report does not come from
  // the UART.
  void raw_input(ByteView report);

  Cp2110Chip chip() const { return locked(chip_); }
  std::size_t host_waiting() const;  // number of bytes in reports that the host has not read yet
  // Returns the number of reports dropped because the host's buffer of 64 reports was full.
  std::uint64_t host_dropped() const { return locked(host_dropped_); }
  std::uint64_t opened() const { return locked(opened_); }  // number of times the node was opened

 private:
  void on_plug(int fifo) override;
  void on_unplug() override;
  Answer on_ioctl(Client client, unsigned long request, UMockdevIoctlData* argument) override;
  std::optional<Answer> on_read() override;
  std::optional<Answer> on_write(ByteView bytes) override;
  void on_client() override;
  void input(ByteView report);
  void pump();
  template <class T>
  T locked(const T& value) const {
    const std::lock_guard lock(mutex_);
    return value;
  }

  mutable std::mutex mutex_;  // protects the members below
  std::condition_variable wake_;
  Cp2110Chip chip_;
  int fifo_ = -1;
  bool plugged_ = false, ending_ = false;
  std::uint64_t host_dropped_ = 0, opened_ = 0;
  std::thread pump_thread_;
};

}  // namespace echofuse::sim
