// SPDX-License-Identifier: MIT
// A request that is no WebSocket gets the page, its parts, the metrics, or a refusal.
#pragma once
#include <utility>  // std::exchange, which Boost 1.74's asio/awaitable.hpp uses without it
// clang-format off: the header above comes first
#include <boost/beast/http.hpp>
// clang-format on
#include <functional>
#include <string>
#include <string_view>

#include "recon/view/access.hpp"

namespace echofuse::view {

namespace http = boost::beast::http;
using HttpRequest = http::request<http::empty_body>;
using HttpResponse = http::response<http::string_body>;
inline constexpr std::uint32_t most_header_bytes = 8192;

// It says who sent a request, and what it wants. If `refusal` is not ok, it is the answer.
struct Caller {
  http::status refusal = http::status::ok;
  std::string why;
  std::string path;
  bool may_write = false;
};
// `socket`: it wants to become a WebSocket, whose Origin is checked as well.
Caller caller_of(const HttpRequest& request, const Access& access, bool socket);

HttpResponse respond(const HttpRequest& request, const Access& access,
                     const std::function<std::string()>& metrics);

// A part of the page, as the build has put it into the program.
struct PageFile {
  std::string_view name, type, contents;
};
const PageFile* page_file(std::string_view name);  // null: there is none

}  // namespace echofuse::view
