// SPDX-License-Identifier: MIT
#include "drivers/core/exit_code.hpp"
#include "sim/usb/usb_lab.hpp"

namespace echofuse::sim {
namespace {

[[noreturn]] void refuse() {
  throw Error(ExitCode::failed,
              "this build has no USB emulation; install libumockdev-dev and build again");
}

}  // namespace

void UsbLab::enter(char**) { refuse(); }
std::unique_ptr<UsbLab> UsbLab::make(boost::asio::io_context&, ScenePlayer&, const TdcOptions&) {
  refuse();
}

}  // namespace echofuse::sim
