// SPDX-License-Identifier: MIT
#include "laboratory.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <sstream>
#include <utility>

#include "../fixtures/paths.hpp"
#include "acquire/config/config.hpp"
#include "drivers/util/settings.hpp"
#include "sim/devices/block_server.hpp"
#include "sim/devices/uart.hpp"
#include "sim/scene/scene_list.hpp"
#include "sim/sensors/depth_camera.hpp"

namespace echofuse::test {
namespace {

using namespace std::chrono_literals;
using sim::FaultKind;

// Each test must use its own device addresses, because the daemon locks devices by address.
struct Addresses {
  explicit Addresses(const LaboratoryOptions& o)
      : tagger("bridge:tcp://tagger-" + o.name + ":1"),
        camera("bridge:tcp://camera-" + o.name + ":1"),
        cli("serial:/virtual/" + o.name + "/cli"),
        data("serial:/virtual/" + o.name + "/data") {}
  std::string tagger, camera, cli, data;
};

std::string radar_cfg(const std::string& name) {
  if (!name.empty()) return read_config_text(source_dir + "/config/radar/" + name);
  std::string cfg = read_config_text(source_dir + "/config/radar/xwr68xx_paper_50cm.cfg");
  const std::string period = "frameCfg 0 2 32 0 50 ";
  return cfg.replace(cfg.find(period), period.size(), "frameCfg 0 2 32 0 250 ");
}

class WireUart final : public sim::Uart {
 public:
  WireUart(port::Loop& loop, Wire& wire, unsigned baud) : Uart(loop, baud, 4ms), wire_(wire) {}

 private:
  std::size_t deliver(Bytes chunk) override {
    if (!wire_.connected()) return 0;
    wire_.send(chunk);
    return chunk.size();
  }
  Wire& wire_;
};

// Simulates a depth camera behind the bridge protocol.
class Camera final : public sim::Device {
 public:
  Camera(port::Loop& loop, sim::ScenePlayer& player, MemoryListener& listener,
         const sim::FaultPlan& plan, std::uint64_t seed)
      : player_(player),
        columns_(record::depth_x_axis(40, 0.8)),
        rows_(record::depth_y_axis(30, 0.6)),
        timer_(loop),
        next_(loop.now()),
        injector_(loop, player, "depth", plan, seed, [this] { server_.poll(); }),
        server_(listener, injector_,
                R"({"model":"simulated camera","serial":"SIM-CAM-1","firmware":"1.0"})", 1 << 20,
                {.connected = [] {},
                 .log =
                     [this](HostTime time, const char* what, const auto* block) {
                       if (block && block->items > 0) put_log(time, what, block->items);
                     }}) {
    wait();
  }
  void stop() override {
    timer_.cancel();
    injector_.stop();
    server_.stop();
  }
  void turn() { columns_.start += 0.1; }
  std::vector<std::pair<std::string, std::uint64_t>> sent() const override { return {}; }

 private:
  void wait() {
    next_ += 500ms;
    timer_.at(next_, [this] {
      frame();
      wait();
    });
  }

  void frame() {
    ++index_;
    if (!server_.connected()) return put_log(injector_.now(), "unseen", index_);
    if (injector_.active(FaultKind::stall)) return put_log(injector_.now(), "stalled", index_);
    const double now_s = player_.now_s();
    Bytes payload;
    put(payload, columns_.count);
    put(payload, rows_.count);
    put(payload,
        static_cast<std::uint64_t>(std::max(0.0, 1e6 * (now_s + injector_.clock_error_s(now_s)))));
    put(payload, index_);
    for (const double axis : {columns_.start, columns_.step, rows_.start, rows_.step})
      put(payload, static_cast<float>(axis));
    if (last_.empty() || !injector_.active(FaultKind::freeze)) last_ = picture(now_s);
    const ByteView raw = as_bytes(last_);
    payload.insert(payload.end(), raw.begin(), raw.end());
    server_.put({.kind = sim::BlockKind::depth, .bytes = std::move(payload), .items = index_});
  }

  // Returns an image that differs from the previous image, like the frames of a real camera.
  std::vector<std::uint16_t> picture(double time_s) {
    const sim::RenderedScene& rendered = player_.at(time_s);
    if (std::exchange(pictured_, rendered.index) != rendered.index)
      pixels_ = sim::render_depth_mm(rendered.scene, columns_, rows_);
    auto pixels = pixels_;
    for (auto& mm : pixels) mm = static_cast<std::uint16_t>(mm + (mm > 0 ? index_ % 7 : 0));
    return pixels;
  }

  void put_log(HostTime time, const char* what, std::uint64_t frame) {
    injector_.log(time, what, {{"frame", static_cast<std::int64_t>(frame)}});
  }

  sim::ScenePlayer& player_;
  Axis columns_, rows_;
  port::Timer timer_;
  HostTime next_;
  std::vector<std::uint16_t> pixels_,
      last_;  // depth map of the scene, and pixels of the last frame sent
  std::int64_t pictured_ = -1;
  std::uint32_t index_ = 0;
  sim::FaultInjector injector_;
  sim::BlockServer server_;
};

std::string lab_toml(const LaboratoryOptions& o, const sim::Conditions& c) {
  const Addresses at(o);
  std::ostringstream out;
  out << "[run]\nwindow_s = " << o.window_s << "\n[tdc]\naddress = \"" << at.tagger
      << "\"\nfirst_bin_ps = " << std::lround(c.first_bin_ps) << "\nbins = " << c.bins
      << "\n[radar]\ncli = \"" << at.cli << "\"\ndata = \"" << at.data
      << "\"\ncfg = \"radar.cfg\"\n"
      << (o.radar_required ? "policy = \"required\"\n" : "") << "[depth]\naddress = \"" << at.camera
      << "\"\nmap_size = 32\n"
      << o.assignments;
  return out.str();
}

sim::Conditions conditions_of(const LaboratoryOptions& o) {
  sim::Conditions c;
  c.signal_photons = o.signal_photons;
  c.background_counts = 30;
  c.spd_rays = 64;
  if (o.change) o.change(c);
  return c;
}

sim::SceneSchedule schedule_of(const LaboratoryOptions& o) {
  sim::SceneSchedule s{o.scene, static_cast<std::int64_t>(o.seed), o.hold_s};
  if (!o.scenes.empty()) s.list = sim::read_scene_list(o.scenes, "scenes");
  return s;
}

}  // namespace

struct Laboratory::Parts {
  Parts(port::VirtualLoop& loop, const LaboratoryOptions& o)
      : options(o),
        player(loop, conditions_of(o), schedule_of(o)),
        camera_wire(loop),
        cli(loop,
            [this](ByteView bytes) {
              if (receive) receive(bytes);
            }),
        data(loop, [](ByteView) {}) {
    plan.faults = o.faults;
    if (!o.log.empty()) plan.sent_log = &sent_log.emplace(o.log);
    auto listener = std::make_unique<MemoryListener>(loop);
    const Addresses at(o);
    loop.ports = {{at.tagger, listener->opener()},
                  {at.camera, camera_wire.opener()},
                  {at.cli, cli.opener()},
                  {at.data, data.opener()}};
    tagger = sim::make_tdc_bridge(loop, player,
                                  {.tagging = {.laser_rate_hz = o.laser_rate_hz},
                                   .window_s = 3,
                                   .seed = o.seed,
                                   .tick = 100ms,
                                   .longest = 100ms,
                                   .plan = plan},
                                  std::move(listener));
    radar = sim::make_radar_board(
        loop, player,
        {.seed = o.seed,
         .plan = plan,
         .sdk = o.radar_sdk,
         .plug = [this](bool in) { cli.plug(in), data.plug(in); }},
        [&](unsigned baud, sim::Uart::Receive to_board) {
          receive = std::move(to_board);
          return std::make_unique<WireUart>(loop, cli, baud);
        },
        [&](unsigned baud, const sim::Uart::Receive&) {
          return std::make_unique<WireUart>(loop, data, baud);
        });
    camera = std::make_unique<Camera>(loop, player, camera_wire, plan, o.seed);
    std::ofstream(o.folder + "/radar.cfg") << radar_cfg(o.radar_cfg);
    configure();
  }

  void configure() {
    const std::string path = options.folder + "/lab.toml";
    std::ofstream(path) << lab_toml(options, player.conditions());
    config = acquire::load_config(path);
    config.operator_name = "operator";
  }

  LaboratoryOptions options;
  sim::ScenePlayer player;
  sim::FaultPlan plan;
  std::optional<sim::SentLog> sent_log;
  MemoryListener camera_wire;
  sim::Uart::Receive receive;
  Wire cli, data;
  std::unique_ptr<sim::Device> tagger, radar;
  std::unique_ptr<Camera> camera;
  acquire::Config config;
  std::vector<std::string> assignments;
};

Laboratory::Laboratory(const LaboratoryOptions& options)
    : parts_(std::make_unique<Parts>(loop, options)) {}
Laboratory::~Laboratory() = default;

void Laboratory::set(std::initializer_list<std::string> assignments, bool with_calibration) {
  parts_->assignments.insert(parts_->assignments.end(), assignments);
  parts_->config = acquire::load_config(parts_->options.folder + "/lab.toml", parts_->assignments,
                                        with_calibration);
}

void Laboratory::choke_radar(bool choked) { parts_->cli.choked = choked; }

const acquire::Config& Laboratory::config() const { return parts_->config; }

bool Laboratory::radar_radiates() const {
  const auto sent = parts_->radar->sent();
  return std::any_of(sent.begin(), sent.end(),
                     [](auto& count) { return count.first == "radiates" && count.second > 0; });
}

void Laboratory::turn_camera() { parts_->camera->turn(); }

ExitCode Laboratory::record(acquire::RunOptions run) {
  run.quiet = true;
  if (run.uuid.empty()) run.uuid = "00000000-0000-4000-8000-000000000001";
  return acquire::record_run(parts_->config, run, loop);
}

void Laboratory::close() {
  parts_->tagger->stop();
  parts_->radar->stop();
  parts_->camera->stop();
  loop.run_for(1s);
  if (parts_->sent_log) parts_->sent_log->close();
}

}  // namespace echofuse::test
