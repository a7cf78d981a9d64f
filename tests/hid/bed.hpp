// SPDX-License-Identifier: MIT
#pragma once
#include <umockdev.h>

namespace echofuse::test {

// The emulated bus of this program.
UMockdevTestbed* bed();

}  // namespace echofuse::test
