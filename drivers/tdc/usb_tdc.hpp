// SPDX-License-Identifier: MIT
// A time tagger on USB that speaks the protocol of USB.md.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "drivers/core/driver.hpp"
#include "drivers/port/address.hpp"

namespace echofuse::port {
class RawKeeper;
}

namespace echofuse::tdc {

// Threading: as every driver. A thread of its own makes all libusb calls, copies and posts; at most
// 64 MiB of tags are on their way, further ones are dropped and counted as lost items.
// Into `raw`, if any, go all transfers (usb_protocol.hpp).
class UsbTdc final : public Driver {
 public:
  // What its transfers take of the kernel's usbfs memory.
  static constexpr std::size_t ring_bytes = std::size_t{2} << 20;

  UsbTdc(boost::asio::io_context& io, std::string address, port::UsbAddress usb, const Clock& clock,
         port::RawKeeper* raw = nullptr);
  ~UsbTdc() override;  // waits for the thread: it cancels its transfers and tells the device
  void start(SampleSink& sink) override;
  void stop() override;
  bool finished() const override;
  std::vector<Counter> counters() const override;

 private:
  struct Shared;
  class Worker;
  std::shared_ptr<Shared> shared_;
  std::string address_;
  port::UsbAddress usb_;
  const Clock& clock_;
  port::RawKeeper* raw_;
};

}  // namespace echofuse::tdc
