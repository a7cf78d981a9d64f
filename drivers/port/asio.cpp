// SPDX-License-Identifier: MIT
// What of Asio is no template is compiled here alone.
#include <utility>  // std::exchange, which Boost 1.74's asio/awaitable.hpp uses without it
// clang-format off: the header above comes first
#include <boost/asio/impl/src.hpp>
// clang-format on
