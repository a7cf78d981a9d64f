// SPDX-License-Identifier: MIT
// UART of a board behind an emulated CP2110.
#pragma once
#include <memory>
#include <utility>

#include "drivers/port/loop.hpp"
#include "sim/devices/uart.hpp"
#include "tests/emulation/hid_cp2110.hpp"

namespace echofuse::sim {

class HidUart final : public Uart {
 public:
  HidUart(port::SystemLoop& loop, UsbBed& bed, HidOptions options, unsigned baud, Receive receive);
  ~HidUart() override;
  HidCp2110& bridge() { return *bridge_; }

 private:
  std::size_t deliver(Bytes chunk) override { return bridge_->receive(chunk); }

  // Cleared by the destructor, because bytes may still arrive after the object has been destroyed.
  std::shared_ptr<Receive> receive_;
  std::unique_ptr<HidCp2110> bridge_;
};

}  // namespace echofuse::sim
