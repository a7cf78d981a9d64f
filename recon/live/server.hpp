// SPDX-License-Identifier: MIT
// Serves the page and its messages over HTTP and WebSocket (RFC 6455). Reads and computes nothing
// while no browser is connected.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "drivers/core/clock.hpp"
#include "recon/live/access.hpp"
#include "recon/live/run_messages.hpp"

namespace echofuse::view {

inline constexpr int most_connections = 64;

struct ServerOptions {
  // A run file or a folder. For a folder, / lists its runs, /run/NAME/ is the page of a run, and
  // /newest/ is that of the newest run. May not exist yet; a missing path counts as a file.
  std::string run;
  std::optional<std::int64_t> planned;  // planned records of the run (of a folder: the newest)
  std::string listen;         // "127.0.0.1:8410"; empty: the first free port of ten on this machine
  bool until_closed = false;  // end when the run has ended and no browser is connected
};

// Threading: one thread. A slow client skips messages: only the newest of each kind is queued. A
// client that answers no ping for 10 s is disconnected.
class Server {
 public:
  // Throws Error(usage) if the address is invalid, Error(failed) if it cannot listen there. `model`
  // may be null and must outlive the server.
  Server(const ServerOptions& options, const LiveModel* model, const Clock& clock);
  ~Server();
  std::string address() const;  // URL for a browser, with the token
  // Returns why no run can be shown yet, or empty. Throws Error(failed) if the file is not a run.
  std::string missing();
  void run();  // until interrupted()

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace echofuse::view
