// SPDX-License-Identifier: MIT
// Laboratory in virtual time with its own folder, functions that read its run, and a device behind
// a bridge.
#pragma once
#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <deque>

#include "../fixtures/folder.hpp"
#include "../fixtures/laboratory.hpp"
#include "../fixtures/run.hpp"
#include "drivers/util/exit_code.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::test {

using Strings = std::vector<std::string>;

// Returns the text that the action prints to stdout. The text is first stored in the file `path`.
inline std::string printed_by(const std::string& path, const std::function<void()>& action) {
  std::fflush(stdout);
  const int before = ::dup(STDOUT_FILENO);
  const int file = ::open(path.c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0600);
  ::dup2(file, STDOUT_FILENO);
  action();
  std::fflush(stdout);
  ::dup2(before, STDOUT_FILENO);
  ::close(before), ::close(file);
  return contents(path);
}

struct Bench {
  explicit Bench(LaboratoryOptions with = {}) {
    spdlog::set_level(spdlog::level::off);
    with.folder = std::string(folder / "");
    with.name = std::to_string(::getpid());
    lab.emplace(with);
  }
  void unplug_radar() {
    lab->loop.ports.erase("serial:/virtual/" + std::to_string(::getpid()) + "/cli");
  }
  acquire::RunOptions run(std::int64_t count) const {
    acquire::RunOptions options;
    options.out = folder / "run.sqlite";
    options.count = count;
    return options;
  }
  record::RunReader reader() const { return record::RunReader(folder / "run.sqlite"); }
  std::vector<FusedRecord> records() const { return records_of(folder / "run.sqlite"); }
  // Records `count` slots without an error, and returns the records.
  std::vector<FusedRecord> record(std::int64_t count) {
    REQUIRE(lab->record(run(count)) == ExitCode::ok);
    return records();
  }
  Strings verdicts(Sensor sensor) const {
    Strings all;
    for (const auto& r : records()) {
      const std::string text = verdict(r, sensor);
      all.push_back(text.substr(0, text.find(':')));
    }
    return all;
  }
  Strings events(const std::string& source) const {
    Strings all;
    for (const auto& e : reader().events())
      if (e.source == source) all.push_back(e.text);
    return all;
  }
  void check_slots(std::chrono::nanoseconds window) const {
    const auto all = records();
    for (std::size_t k = 0; k < all.size(); ++k) {
      CHECK(all[k].index == static_cast<std::int64_t>(k));
      CHECK(all[k].slot_start == all[0].slot_start + static_cast<std::int64_t>(k) * window);
      CHECK(all[k].slot_end == all[k].slot_start + window);
      CHECK(std::accumulate(counts(all[k]).begin(), counts(all[k]).end(), 0u) ==
            (all[k].has(Sensor::spd) ? all[k].spd_counts.in_range : 0));
    }
  }

  Folder folder;
  std::optional<Laboratory> lab;
};

inline sim::Fault fault(const char* device, sim::FaultKind kind, double at_s, double for_s,
                        double amount = 0) {
  return {.device = device, .kind = kind, .at_s = at_s, .for_s = for_s, .amount = amount};
}

inline bool has(const Strings& all, const std::string& beginning) {
  return std::ranges::any_of(all, [&](auto& t) { return t.starts_with(beginning); });
}

// Device behind a bridge. Sends `hello` when a client connects, then calls `send_next` every 50 ms.
class BridgedDevice {
 public:
  BridgedDevice(port::Loop& loop, std::string hello, std::function<void(BridgedDevice&)> send_next)
      : hello_(std::move(hello)), send_next_(std::move(send_next)), timer_(loop), listener(loop) {
    listener.start({.connected = [this] { begin(); },
                    .left =
                        [this] {
                          timer_.cancel();
                          listener.accept();
                        }});
    listener.accept();
  }

  // Connects the daemon to the device instead of the radar and the sensor with the setting
  // `address`.
  void attach(Bench& b, const std::string& address, Strings settings = {}) {
    // Tests that run at the same time must use their own device addresses (laboratory.cpp).
    const std::string uri = "bridge:tcp://device-" + std::to_string(::getpid()) + ":1";
    b.lab->loop.ports[uri] = listener.opener();
    settings.insert(settings.end(), {"radar.cli=", "radar.data=", address + "=" + uri});
    b.lab->set(settings, false);
  }
  std::uint32_t number() const { return number_; }  // number of the next block
  void lose_block() { ++number_; }
  // A damaged block has a wrong last byte.
  void send(sim::BlockKind kind, const Bytes& payload, bool damaged = false) {
    sent_.push_back(sim::bridge_block(kind, number_++, 0, payload));
    if (damaged) sent_.back().back() ^= 1;
    listener.write(sent_.back(), [](bool) {});
  }

 private:
  void begin() {
    number_ = 0;
    send(sim::BlockKind::hello, {hello_.begin(), hello_.end()});
    next();
  }
  void next() {
    send_next_(*this);
    timer_.after(std::chrono::milliseconds(50), [this] { next(); });
  }

  std::string hello_;
  std::function<void(BridgedDevice&)> send_next_;
  port::Timer timer_;
  std::deque<Bytes> sent_;
  std::uint32_t number_ = 0;

 public:
  MemoryListener listener;
};

}  // namespace echofuse::test
