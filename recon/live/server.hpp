// SPDX-License-Identifier: MIT
// Serves the page and its messages over HTTP and WebSocket (RFC 6455). Does not read the run while
// no browser is connected.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "drivers/core/clock.hpp"
#include "recon/live/access.hpp"
#include "recon/live/run_messages.hpp"

namespace echofuse::view {

inline constexpr int max_connections = 64;

struct ServerOptions {
  // Run file or folder; may not exist yet. A missing path is treated as a run file. For a folder,
  // the page / lists its runs, /run/NAME/ shows one run, and /newest/ shows the newest one.
  std::string run;
  // Number of records planned for the run or, in a folder, for the newest run.
  std::optional<std::int64_t> planned;
  std::string listen;  // address, e.g. "127.0.0.1:8410"; empty: loopback interface, first free port
  bool until_closed = false;  // true: exit once the run has ended and no browser is connected
};

// Threading: must be used from one thread only. For a slow client, only the newest message of each
// kind is queued, and older ones are dropped. A client that does not answer a ping within 10 s is
// disconnected.
class Server {
 public:
  // Throws Error(usage) if the listening address is invalid, and Error(failed) if this address
  // cannot be used. `model` may be null; otherwise it must outlive the server.
  Server(const ServerOptions& options, const LiveModel* model, const Clock& clock);
  ~Server();
  std::string address() const;  // returns the URL of the page, including the token
  // Returns the reason why a run cannot be displayed yet; empty if a run can be displayed. Throws
  // Error(failed) if the file is not a run.
  std::string missing();
  void run();  // serves until interrupted() is true

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace echofuse::view
