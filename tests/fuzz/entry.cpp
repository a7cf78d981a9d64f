// SPDX-License-Identifier: MIT
#include "fuzz.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  echofuse::fuzz::run({data, size});
  return 0;
}
