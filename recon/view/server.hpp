// SPDX-License-Identifier: MIT
// The page and its messages over HTTP and WebSocket (RFC 6455), for browsers and Prometheus.
// Nothing is read or computed while nobody is connected.
#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "drivers/core/clock.hpp"
#include "recon/view/access.hpp"
#include "recon/view/show.hpp"

namespace echofuse::view {

inline constexpr int most_connections = 64;

struct ServerOptions {
  std::string listen;         // "127.0.0.1:8410"; empty: this machine, the first free port of ten
  bool until_closed = false;  // ends once the run is over and nobody looks
};

// Threading: one thread. A slow client skips frames (of each kind the newest one waits), and is
// dropped if it answers no ping for 10 s.
class Server {
 public:
  // Throws Error(usage) for an address that is none, Error(failed) if it cannot listen there.
  Server(Show& show, const ServerOptions& options, const Clock& clock);
  ~Server();
  std::string address() const;  // for a browser, with the token
  void run();                   // until interrupted()

 private:
  class Loop;
  std::unique_ptr<Loop> loop_;
};

}  // namespace echofuse::view
