// SPDX-License-Identifier: MIT
// Compiles the functions of Asio that are not templates, once for all sources.
#include <utility>  // std::exchange, which Boost 1.74's asio/awaitable.hpp uses without it
// clang-format off: the header above must come first
#include <boost/asio/impl/src.hpp>
// clang-format on
