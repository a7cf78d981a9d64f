// SPDX-License-Identifier: MIT
// Checks HTTP requests. Answers those that are not WebSocket upgrades with a page, a script, the
// list of runs, or an error.
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
inline constexpr std::uint32_t max_header_bytes = 8192;

// Target and access rights of a request. If `refusal` is not `ok`, it is the HTTP status of the
// response. If the server shows a folder, /run/NAME/ is the page of the run NAME, and /newest/ is
// the page of the newest run. Whether the run exists is not checked.
struct Caller {
  http::status refusal = http::status::ok;
  std::string why;
  std::string path;   // path relative to the page of the run
  std::string run;    // run name; empty: the only run, or the newest one
  bool page = false;  // true: `/` is the page of a run; false: it is the list of runs
  bool may_write = false;
};
// Checks a request and returns its target and access rights. `socket`: true for a WebSocket
// upgrade. The path /live accepts only WebSocket upgrades; all other paths reject them.
Caller caller_of(const HttpRequest& request, const Access& access, bool socket);

// Returns the HTTP response. If the server shows a folder, `runs` returns the JSON text sent for
// the path /runs.
HttpResponse respond(const HttpRequest& request, const Caller& caller,
                     const std::function<std::string()>& runs);

// A file of the web page. All files of the page are embedded in the program.
struct PageFile {
  std::string_view name, type, contents;
};
const PageFile* page_file(std::string_view name);  // Returns null if no page file has this name.

}  // namespace echofuse::view
