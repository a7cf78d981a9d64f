// SPDX-License-Identifier: MIT
// Compiles the part of Asio that is no template, here alone.
#include <utility>  // std::exchange, which Boost 1.74's asio/awaitable.hpp uses without it
// clang-format off: the header above comes first
#include <boost/asio/impl/src.hpp>
// clang-format on
