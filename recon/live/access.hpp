// SPDX-License-Identifier: MIT
// Access rules: decide which requests may read a run, and which may write to it. They have no side
// effects.
//
// Any web page can make a browser send requests to 127.0.0.1. Therefore two headers of each request
// are checked:
//   Host    must be a loopback address if the server listens only there, where reading needs no
//           token. This prevents DNS rebinding. Otherwise the token decides, and any name is valid.
//   Origin  must be the host of this server's page. If a proxy sets X-Forwarded-Host, that host is
//           used. A web page cannot set X-Forwarded-Host for a WebSocket. For an HTTP request to
//           another host it can do so only after a preflight request.
#pragma once
#include <string>
#include <string_view>

namespace echofuse::view {

struct Access {
  std::string token;         // random token, created each time the server starts
  bool needs_token = false;  // true: reading requires the token; writing always requires it
  bool loopback = true;      // true: the server listens only on the loopback interface
  bool many = false;         // true: the server shows a folder of runs

  // Returns true for "127.0.0.1:8410", "[::1]", "localhost" and the like; also for every other name
  // unless the server listens only on the loopback interface.
  bool accepts_host(std::string_view host) const;
  // Returns true if the request comes from this server's page, or if it does not come from a web
  // page (empty `origin`). `host`: X-Forwarded-Host if a proxy sets it, otherwise Host.
  bool accepts_origin(std::string_view origin, std::string_view host) const;
  bool may_read(std::string_view given) const { return !needs_token || is_token(given); }
  bool may_write(std::string_view given) const { return is_token(given); }

 private:
  bool is_token(std::string_view given) const;
};

// Returns a token of 128 random bits as hexadecimal digits.
std::string make_token();

// Result of target_of(), which splits "/live?token=12" into "/live" and "12". Other parameters are
// ignored.
struct Target {
  std::string_view path, token;
};
Target target_of(std::string_view target);

// Decodes percent escapes, e.g. "a%20b" to "a b". Leaves invalid escapes unchanged.
std::string decoded(std::string_view part);

}  // namespace echofuse::view
