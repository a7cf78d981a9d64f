// SPDX-License-Identifier: MIT
// Access rules: which requests may read a run, and which may write to it. No side effects.
//
// Any web page can make a browser send requests to 127.0.0.1, so each request is checked:
//   Host    must be a name of this machine that no foreign DNS entry can have (DNS rebinding)
//   Origin  for a WebSocket, must be the host of this server's page (X-Forwarded-Host if a proxy
//           sets it; a web page can set that field neither for a WebSocket nor, without a
//           preflight, for another host)
#pragma once
#include <string>
#include <string_view>

namespace echofuse::view {

struct Access {
  std::string token;         // made at each start of the server
  bool needs_token = false;  // reading needs the token; writing always does
  bool loopback = true;      // true: listens on this machine only
  bool many = false;         // serves a folder of runs
  std::string host_name;     // name of this machine

  // Accepts "127.0.0.1:8410", "[::1]", "localhost"; refuses the name of another machine.
  bool accepts_host(std::string_view host) const;
  // An empty origin means that no web page sent the request. `host` is X-Forwarded-Host if a proxy
  // sets it, otherwise Host.
  bool accepts_origin(std::string_view origin, std::string_view host) const;
  bool may_read(std::string_view given) const { return !needs_token || is_token(given); }
  bool may_write(std::string_view given) const { return is_token(given); }

 private:
  bool is_token(std::string_view given) const;
};

// Returns 128 random bits of the system as hexadecimal digits.
std::string make_token();

// Splits "/live?token=12" into "/live" and "12"; ignores other parameters.
struct Target {
  std::string_view path, token;
};
Target target_of(std::string_view target);

// Decodes "a%20b" to "a b"; leaves an invalid escape unchanged.
std::string decoded(std::string_view part);

}  // namespace echofuse::view
