// SPDX-License-Identifier: MIT
// Answers an HTTP request that is not a WebSocket: a page, its scripts, the list of runs, or an
// error.
#pragma once
#include <utility>  // std::exchange: Boost 1.74's asio/awaitable.hpp uses it without the include
// clang-format off: the header above comes first
#include <boost/beast/http.hpp>
// clang-format on
#include <functional>
#include <string>
#include <string_view>

#include "recon/live/access.hpp"

namespace echofuse::view {

namespace http = boost::beast::http;
using HttpRequest = http::request<http::empty_body>;
using HttpResponse = http::response<http::string_body>;
inline constexpr std::uint32_t most_header_bytes = 8192;

// Access rights and target of a request. If `refusal` is not ok, it is the response. In a folder,
// /run/NAME/ is the page of a run, whether it exists or not; /newest/ is that of the newest run.
struct Caller {
  http::status refusal = http::status::ok;
  std::string why;
  std::string path;   // below the run's path
  std::string run;    // run name; empty: the only run, or the newest of the folder
  bool page = false;  // page of a run; otherwise / is the list of runs
  bool may_write = false;
};
// `socket`: the request asks for a WebSocket, so its Origin is checked as well.
Caller caller_of(const HttpRequest& request, const Access& access, bool socket);

// `runs` returns the body of /runs for a folder.
HttpResponse respond(const HttpRequest& request, const Caller& caller,
                     const std::function<std::string()>& runs);

// A file of the page, embedded by the build.
struct PageFile {
  std::string_view name, type, contents;
};
const PageFile* page_file(std::string_view name);  // null if not found

}  // namespace echofuse::view
