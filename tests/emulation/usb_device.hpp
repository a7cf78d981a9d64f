// SPDX-License-Identifier: MIT
// USB device with one vendor-specific interface and one bulk IN endpoint below Linux usbfs
// (linux/usbdevice_fs.h). Transfers wait until the device has data. Packets may end them early.
#pragma once
#include <array>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>

#include "tests/emulation/usb_bed.hpp"

namespace echofuse::sim {

struct UsbIdentity {
  std::uint16_t vendor = 0, product = 0, release_bcd = 0x0100;
  std::string manufacturer, name, serial;
  std::uint8_t interface_subclass = 0, interface_protocol = 0;
  unsigned number = 9;  // number of the USB bus
};

// One thread must create, plug, unplug and destroy the device. send(), halt() and waiting() may be
// called on any thread. The control handler runs on umockdev's thread and under the device's lock.
// It may call clear().
class UsbDevice final : public BedNode {
 public:
  static constexpr std::uint8_t bulk_in = 0x81;
  static constexpr std::size_t packet_bytes = 512;  // size of a high-speed bulk packet

  struct Setup {
    std::uint8_t type, request;
    std::uint16_t value, index, length;
    bool in() const { return type & 0x80; }
  };
  // Returns the answer to a vendor request (empty for OUT requests), or nullopt to stall the
  // request.
  using Control = std::function<std::optional<Bytes>(const Setup&)>;

  UsbDevice(UsbBed& bed, const UsbIdentity& identity, Control control);
  ~UsbDevice() override;

  // Sends a run of packets, which ends with a short or empty packet. If `ends` is false, the run
  // continues, and a partial packet waits for the bytes of the next call.
  void send(ByteView bytes, bool ends = true);
  // number of bytes sent that the host has not read yet
  std::size_t waiting() const;
  void clear();  // drops the bytes that the host has not read yet
  // Stalls the endpoint until the host clears the halt condition.
  void halt();
  // number of bytes in completed transfers
  std::uint64_t fetched() const { return locked(fetched_); }
  bool claimed() const { return locked(owner_) != nullptr; }

 private:
  struct Transfer {
    Client client;
    ClientData urb;
  };

  void on_plug(int fifo) override;
  void on_unplug() override;
  Answer on_ioctl(Client client, unsigned long request, UMockdevIoctlData* argument) override;
  void on_client_gone(Client client) override;

  Answer capabilities(UMockdevIoctlData* argument);
  Answer claim(Client client);
  Answer submit(Client client, UMockdevIoctlData* argument);
  Answer reap(Client client, UMockdevIoctlData* argument);
  Answer discard(Client client, UMockdevIoctlData* argument);
  void control(Transfer transfer);
  std::optional<Bytes> string_descriptor(const Setup& setup) const;
  void fill();
  std::size_t room_of_first() const;
  void finish_first(int status, std::size_t bytes);
  void finish(Transfer transfer, int status, std::size_t bytes);
  void finish_all(int status);
  void set_reapable(bool reapable);
  template <class T>
  T locked(const T& value) const {
    const std::lock_guard lock(mutex_);
    return value;
  }

  UsbIdentity identity_;
  Control control_;
  mutable std::recursive_mutex mutex_;
  std::deque<Transfer> pending_, done_;
  std::deque<std::uint8_t> data_;
  std::deque<std::size_t> ends_;  // positions in data_ at which a transfer ends
  Client owner_ = nullptr;
  int fifo_ = -1;
  bool reapable_ = false, gone_ = true, halted_ = false;
  std::uint64_t fetched_ = 0;
};

}  // namespace echofuse::sim
