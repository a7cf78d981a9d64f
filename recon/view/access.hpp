// SPDX-License-Identifier: MIT
// Rules of who may see a run, and who may write into it, without side effects.
//
// Any page can make a browser ask 127.0.0.1, so the request is checked:
//   Host    this machine, by a name that no foreign DNS entry can be (against rebinding)
//   Origin  of a WebSocket: the page of this server, or by a proxy's X-Forwarded-Host
// No browser lets a page set X-Forwarded-Host for a WebSocket, nor for another Host without asking.
#pragma once
#include <string>
#include <string_view>

namespace echofuse::view {

struct Access {
  std::string token;         // token of this start of the server
  bool token_asked = false;  // to look; to write it is asked always
  bool loopback = true;      // true: listens to this machine only
  bool many = false;         // runs of a folder, of which one is chosen
  std::string host_name;     // name of this machine

  // "127.0.0.1:8410", "[::1]", "localhost": another machine's name is refused.
  bool takes_host(std::string_view host) const;
  // Empty: not from a page. `host`: as the browser asked for it, which a proxy says.
  bool takes_origin(std::string_view origin, std::string_view host) const;
  bool may_look(std::string_view given) const { return !token_asked || is_token(given); }
  bool may_write(std::string_view given) const { return is_token(given); }

 private:
  bool is_token(std::string_view given) const;
};

// 128 bits of the system's random numbers, in hexadecimal digits.
std::string make_token();

// "/live?token=12" -> "/live" and "12". Other parameters are left out.
struct Target {
  std::string_view path, token;
};
Target target_of(std::string_view target);

// "a%20b" -> "a b"; what is no such number stays as it is.
std::string decoded(std::string_view part);

}  // namespace echofuse::view
