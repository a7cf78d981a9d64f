// SPDX-License-Identifier: MIT
// Compiles the part of Asio that is not a template, once.
#include <utility>  // std::exchange, which Boost 1.74's asio/awaitable.hpp uses without it
// clang-format off: the header above must come first
#include <boost/asio/impl/src.hpp>
// clang-format on
