// SPDX-License-Identifier: MIT
// A request that is no WebSocket gets a page, its parts, the runs, or a refusal.
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

// Sender and target of a request. A `refusal` other than ok is the answer. In a folder /run/NAME/
// is the page of a run, whether it exists or not. /newest/ is that of the newest.
struct Caller {
  http::status refusal = http::status::ok;
  std::string why;
  std::string path;   // below that of the run
  std::string run;    // its name; empty: the only one, or the newest of the folder
  bool page = false;  // page of a run; else / chooses one
  bool may_write = false;
};
// `socket`: it wants to become a WebSocket, whose Origin is checked as well.
Caller caller_of(const HttpRequest& request, const Access& access, bool socket);

// `runs` makes /runs of a folder.
HttpResponse respond(const HttpRequest& request, const Caller& caller,
                     const std::function<std::string()>& runs);

// A part of the page, as the build has put it into the program.
struct PageFile {
  std::string_view name, type, contents;
};
const PageFile* page_file(std::string_view name);  // null: there is none

}  // namespace echofuse::view
