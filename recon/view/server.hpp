// SPDX-License-Identifier: MIT
// The page and its messages over HTTP and WebSocket (RFC 6455), for browsers and Prometheus.
// Nothing is read or computed while nobody is connected.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "drivers/core/clock.hpp"
#include "recon/view/access.hpp"
#include "recon/view/show.hpp"

namespace echofuse::view {

inline constexpr int most_connections = 64;

struct ServerOptions {
  // A run file, or a folder, whose page at / lists its runs. Each run has its page below
  // /run/NAME/; /newest/ goes with the newest. May not exist yet; a missing path counts as a file.
  std::string run;
  std::optional<std::int64_t> planned;  // records that the run (of a folder: the newest) shall have
  std::string listen;         // "127.0.0.1:8410"; empty: this machine, the first free port of ten
  bool until_closed = false;  // ends once the run is over and nobody looks
};

// Threading: one thread. A slow client skips frames; of each kind the newest one waits. A client
// that answers no ping for 10 s is dropped.
class Server {
 public:
  // Throws Error(usage) for an address that is none, Error(failed) if it cannot listen there.
  // `model` may be null; it outlives this.
  Server(const ServerOptions& options, const LiveModel* model, const Clock& clock);
  ~Server();
  std::string address() const;  // for a browser, with the token
  // Returns why there is no run to see yet, or empty. Throws Error(failed) if something else is
  // there.
  std::string missing();
  void run();  // until interrupted()

 private:
  class Loop;
  std::unique_ptr<Loop> loop_;
};

}  // namespace echofuse::view
