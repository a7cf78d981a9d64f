// SPDX-License-Identifier: MIT
#include <cmath>
#include <nlohmann/json.hpp>

#include "sim/devices/block_server.hpp"
#include "sim/sensors/zone_fields.hpp"

namespace echofuse::sim {
namespace {

constexpr double exposure_s = 0.05;

std::string hello_of(const Zones& zones) {
  nlohmann::json list = nlohmann::json::array();
  for (const Zone& z : zones)
    list.push_back({{"x", z.x}, {"y", z.y}, {"width", z.width}, {"zero_ps", z.zero_ps}});
  return nlohmann::json{{"model", "simulated detector with zones"},
                        {"serial", "SIM-ZONES-1"},
                        {"firmware", "1.0"},
                        {"sends", "histograms"},
                        {"zones", list}}
      .dump();
}

// Detector with zones that sends one histogram block per exposure over the bridge protocol. Each
// histogram shows the scene at the midpoint of its exposure.
class HistogramBridge final : public Device {
 public:
  HistogramBridge(port::Loop& loop, ScenePlayer& player, const TdcOptions& options,
                  std::unique_ptr<Listener> listener)
      : player_(player),
        conditions_(player.conditions()),
        listener_(std::move(listener)),
        timer_(loop),
        next_(loop.now()),
        rng_(make_rng(options.seed, 1)),
        injector_(loop, player, "tdc", options.plan, options.seed, [this] { server_.poll(); }),
        server_(*listener_, injector_, hello_of(zones_of(conditions_)), options.send_queue_bytes,
                {.connected = [] {},
                 .log = [this](auto time, auto what, auto) { injector_.log(time, what, {}); }}) {
    // Exposure time as a fraction of the window, because expected counts are per window.
    const double share = exposure_s / options.window_s;
    conditions_.pulses_per_window =
        std::llround(share * static_cast<double>(conditions_.pulses_per_window));
    conditions_.window_s = exposure_s;
    window_share_ = share;
    wait();
  }

  void stop() override {
    timer_.cancel();
    injector_.stop();
    server_.stop();
  }

  std::vector<std::pair<std::string, std::uint64_t>> sent() const override {
    return {{"clients", server_.clients()},
            {"blocks", server_.sent_blocks()},
            {"histograms", server_.sent_items()}};
  }

 private:
  void wait() {
    next_ += from_seconds(exposure_s);
    timer_.at(next_, [this] {
      server_.greet_again();
      if (server_.connected()) send();
      wait();
    });
  }

  void send() {
    const double end_s = player_.now_s();
    const RenderedScene& scene = player_.at(std::max(0.0, end_s - exposure_s / 2));
    if (scene.index != seen_) rates_ = zone_rates(scene.spd, player_.conditions());
    seen_ = scene.index;
    std::vector<double> rates = rates_;
    for (double& rate : rates) rate *= window_share_ * injector_.gain();
    const HostTime now = injector_.now();
    Bytes payload = histogram_payload(
        draw_zone_counts(rates, conditions_, rng_), static_cast<std::uint32_t>(conditions_.bins),
        static_cast<std::uint64_t>(std::llround(1e6 * (end_s + injector_.clock_error_s(end_s)))),
        static_cast<std::uint64_t>(conditions_.pulses_per_window), conditions_.first_bin_ps,
        conditions_.bin_width_ps, static_cast<std::uint32_t>(std::lround(1e6 * exposure_s)));
    if (!server_.put({.kind = BlockKind::histogram,
                      .bytes = std::move(payload),
                      .items = 1,
                      .first = now,
                      .last = now}))
      server_.lose(1);
  }

  ScenePlayer& player_;
  // settings in which `window_s` and `pulses_per_window` are those of one exposure
  Conditions conditions_;
  double window_share_ = 1;
  std::unique_ptr<Listener> listener_;
  port::Timer timer_;
  HostTime next_;
  Rng rng_;
  std::vector<double> rates_;  // expected number of counts per window for scene number seen_
  std::int64_t seen_ = -1;
  FaultInjector injector_;
  BlockServer server_;
};

}  // namespace

std::unique_ptr<Device> make_histogram_bridge(port::Loop& loop, ScenePlayer& player,
                                              const TdcOptions& options,
                                              std::unique_ptr<Listener> listener) {
  return std::make_unique<HistogramBridge>(loop, player, options, std::move(listener));
}

}  // namespace echofuse::sim
