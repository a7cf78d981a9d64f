// SPDX-License-Identifier: MIT
#include "sim/usb/usb_lab.hpp"

#include "sim/usb/tdc_usb.hpp"

namespace echofuse::sim {
namespace {

class EmulatedUsb final : public UsbLab {
 public:
  EmulatedUsb(boost::asio::io_context& io, ScenePlayer& player, const TdcOptions& tdc)
      : tdc_(make_tdc_usb(io, player, bed_, tdc)) {}

  std::vector<std::pair<std::string, std::string>> environment() const override {
    return bed_.environment();
  }
  std::string tdc_address() const override { return tdc_->address(); }
  Device& tdc() override { return *tdc_; }

 private:
  UsbBed bed_;
  std::unique_ptr<TdcUsb> tdc_;
};

}  // namespace

void UsbLab::enter(char** argv) { UsbBed::enter(argv); }

std::unique_ptr<UsbLab> UsbLab::make(boost::asio::io_context& io, ScenePlayer& player,
                                     const TdcOptions& tdc) {
  return std::make_unique<EmulatedUsb>(io, player, tdc);
}

}  // namespace echofuse::sim
