// SPDX-License-Identifier: MIT
// Access rules: which requests may read a run, and which may write to it. No side effects.
//
// Any web page can make a browser send requests to 127.0.0.1, so each request is checked:
//   Host    a name of this machine that a foreign DNS entry cannot have (DNS rebinding)
//   Origin  of a WebSocket: the host of this server's page; behind a proxy X-Forwarded-Host
// A web page cannot set X-Forwarded-Host for a WebSocket, nor for another host without a preflight.
#pragma once
#include <string>
#include <string_view>

namespace echofuse::view {

struct Access {
  std::string token;         // made at each start of the server
  bool token_asked = false;  // reading needs the token; writing always does
  bool loopback = true;      // true: listens on this machine only
  bool many = false;         // serves a folder of runs
  std::string host_name;     // name of this machine

  // Accepts "127.0.0.1:8410", "[::1]", "localhost"; refuses the name of another machine.
  bool takes_host(std::string_view host) const;
  // An empty origin means that no web page sent the request. `host` is the Host field, or what a
  // proxy reports.
  bool takes_origin(std::string_view origin, std::string_view host) const;
  bool may_look(std::string_view given) const { return !token_asked || is_token(given); }
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
