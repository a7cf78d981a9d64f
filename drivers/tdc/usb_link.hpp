// SPDX-License-Identifier: MIT
// One opened USB time tagger: a ring of bulk transfers and vendor requests. It pulls in libusb: for
// the .cpp files of this folder only.
#pragma once
#include <libusb.h>

#include <array>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/port/address.hpp"
#include "drivers/tdc/usb_protocol.hpp"

namespace echofuse::tdc::usb {

struct LinkCounts {
  std::uint64_t bytes = 0, transfers = 0;
  std::uint64_t stalls = 0;  // times the endpoint was halted, and cleared
  std::uint64_t transfer_errors = 0;
};

// Threading: one thread. The handler is called from serve().
class Link {
 public:
  static constexpr std::size_t transfer_count = 8, transfer_bytes = 256u << 10;

  // A finished transfer; `ends`: with a short or empty packet. Bytes are valid during the call.
  using OnTransfer = std::function<void(ByteView, bool ends)>;
  // Bytes are missing here: the endpoint stalled or a transfer failed.
  using OnGap = std::function<void()>;

  explicit Link(LinkCounts& counts);
  ~Link();  // stops the device, cancels what is under way and waits for it
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  // Finds and opens the device, starts it and the transfers. Empty, or what is wrong.
  std::string open(const port::UsbAddress& address, OnTransfer on_transfer, OnGap on_gap);
  // Waits at most so long for something to happen. Empty, or why the link is at its end.
  std::string serve(std::chrono::milliseconds limit);
  std::optional<Status> status();

  const Info& info() const { return info_; }
  std::string text(std::uint8_t index);  // a string descriptor
  const libusb_device_descriptor& descriptor() const { return descriptor_; }

 private:
  struct Context {
    void operator()(libusb_context* c) const { libusb_exit(c); }
  };
  struct Handle {
    void operator()(libusb_device_handle* h) const { libusb_close(h); }
  };
  struct Slot {
    Link* link = nullptr;
    libusb_transfer* transfer = nullptr;
    Bytes buffer;
    bool busy = false;
  };

  std::string find(const port::UsbAddress& address);
  bool try_device(libusb_device* device, const port::UsbAddress& address, std::string& wrong);
  bool find_interface(libusb_device* device);
  std::string start();
  int request(Request request, Bytes& answer);
  static void LIBUSB_CALL completed(libusb_transfer* transfer);
  void on_completed(Slot& slot);
  int submit(Slot& slot);  // a libusb error, or 0
  std::string recover();
  bool any_busy() const;
  void cancel();

  LinkCounts& counts_;
  std::unique_ptr<libusb_context, Context> context_;
  std::unique_ptr<libusb_device_handle, Handle> handle_;
  libusb_device_descriptor descriptor_{};
  Info info_;
  OnTransfer on_transfer_;
  OnGap on_gap_;
  std::array<Slot, transfer_count> slots_;
  int interface_ = 0;
  std::uint8_t endpoint_ = 0;
  bool claimed_ = false, started_ = false, gone_ = false, halted_ = false, stopping_ = false;
  int errors_in_a_row_ = 0;
};

}  // namespace echofuse::tdc::usb
