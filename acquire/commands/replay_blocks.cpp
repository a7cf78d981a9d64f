// SPDX-License-Identifier: MIT
// Recorded blocks go through the drivers themselves: each file is one connection of a port that
// reads files.
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "acquire/commands/replay.hpp"
#include "drivers/core/bytes.hpp"
#include "drivers/depth/bridge_camera.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "drivers/program/regular_file.hpp"
#include "drivers/tdc/bridge_tdc.hpp"

namespace echofuse::acquire {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t chunk_bytes = 64u << 10;

class FilePort final : public port::BytePort {
 public:
  // `at_end` is called once behind the last byte.
  FilePort(port::Loop& loop, const std::string& path, std::function<void()> at_end)
      : link_(new Link{loop, path, {path, ExitCode::failed}, std::move(at_end), {}, false, {}}) {}
  ~FilePort() override { link_->closed = true; }
  FilePort(const FilePort&) = delete;
  FilePort& operator=(const FilePort&) = delete;

  void open(port::PortHandlers handlers) override {
    link_->handlers = std::move(handlers);
    later(link_, [](const std::shared_ptr<Link>& link) {
      link->handlers.opened();
      later(link, step);
    });
  }
  void write(ByteView) override {}

 private:
  struct Link {
    port::Loop& loop;
    std::string path;
    RegularFile file;
    std::function<void()> at_end;
    port::PortHandlers handlers;
    bool closed;
    Bytes chunk;
  };
  template <class Action>
  static void later(const std::shared_ptr<Link>& link, Action action) {
    link->loop.post([link, action] {
      if (!link->closed) action(link);
    });
  }
  static void step(const std::shared_ptr<Link>& link) {
    link->chunk.resize(chunk_bytes);
    const std::size_t count = link->file.read(link->chunk);
    if (count > 0) link->handlers.bytes(ByteView(link->chunk).first(count));
    if (link->closed) return;
    if (count > 0) return later(link, step);
    link->at_end();
    link->handlers.gone({std::make_error_code(std::errc::no_message_available), link->path});
  }

  std::shared_ptr<Link> link_;
};

// What the driver does not count: where it is.
struct Events final : SampleSink {
  void on_tags(const TagBlock&) override {}
  void on_radar(RadarFrame) override {}
  void on_depth(DepthFrame) override {}
  void on_state(Sensor, DeviceState, const DeviceInfo& info) override {
    if (!info.model.empty()) last = info;
  }
  void on_event(Sensor, Severity, const std::string&) override {}
  DeviceInfo last;
};

// Behind the last file.
struct NoPort final : port::BytePort {
  void open(port::PortHandlers) override {}
  void write(ByteView) override {}
};

template <class BridgeDriver>
Json play(const std::vector<std::string>& paths) {
  port::VirtualLoop loop;
  std::size_t next = 0;
  bool ended = false;
  const auto opener = [&]() -> std::unique_ptr<port::BytePort> {
    if (next == paths.size()) {  // the last one said goodbye
      ended = true;
      return std::make_unique<NoPort>();
    }
    return std::make_unique<FilePort>(loop, paths[next++], [&] { ended = next == paths.size(); });
  };
  BridgeDriver driver(loop, paths[0], opener);
  Events events;
  driver.start(events);
  loop.run_until([&] { return ended; });
  Json json{{"model", events.last.model},
            {"serial", events.last.serial},
            {"firmware", events.last.firmware}};
  for (const Counter& counter : driver.counters()) json[counter.name] = counter.value;
  driver.stop();
  return json;
}

}  // namespace

Replayed replay_tdc(const std::vector<std::string>& paths, bool json) {
  return replay_result(paths, play<tdc::BridgeTdc>(paths), "tags", json);
}

Replayed replay_depth(const std::vector<std::string>& paths, bool json) {
  return replay_result(paths, play<depth::BridgeCamera>(paths), "frames", json);
}

}  // namespace echofuse::acquire
