// SPDX-License-Identifier: MIT
#include "tests/emulation/hid_uart.hpp"

#include <boost/asio/post.hpp>

namespace echofuse::sim {

HidUart::HidUart(port::SystemLoop& loop, UsbBed& bed, HidOptions options, unsigned baud,
                 Receive receive)
    : Uart(loop, baud, std::chrono::milliseconds(1)),
      receive_(std::make_shared<Receive>(std::move(receive))),
      bridge_(std::make_unique<HidCp2110>(
          bed, std::move(options), [&loop, to = receive_](ByteView bytes) {
            loop.post([to, copy = Bytes(bytes.begin(), bytes.end())] {
              if (*to) (*to)(copy);
            });
          })) {}

HidUart::~HidUart() { *receive_ = nullptr; }

}  // namespace echofuse::sim
