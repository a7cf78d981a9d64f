// SPDX-License-Identifier: MIT
#include <algorithm>
#include <array>
#include <cmath>

#include "drivers/core/crc32c.hpp"
#include "drivers/core/random.hpp"
#include "drivers/util/format.hpp"
#include "sim/devices/device.hpp"
#include "sim/devices/fault_injector.hpp"
#include "sim/devices/radar_antennas.hpp"
#include "sim/devices/radar_chirp.hpp"
#include "sim/devices/radar_firmware.hpp"
#include "sim/devices/uart.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::sim {
namespace {

// The demo starts with these baud rates, and counts cycles of the 200 MHz processor (SDK 3.4).
constexpr unsigned cli_baud = 115200, data_baud = 921600;
constexpr double cpu_hz = 200e6;
constexpr double processing_us = 3000;  // time from the last chirp to the first sent byte

ByteView bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::chrono::nanoseconds microseconds(double us) { return from_seconds(us * 1e-6); }

class RadarBoard final : public Device {
 public:
  RadarBoard(port::Loop& loop, ScenePlayer& player, const RadarBoardOptions& options,
             const MakeUart& make_cli, const MakeUart& make_data)
      : player_(player),
        cli_(make_cli(cli_baud, [this](ByteView bytes) { on_command_bytes(bytes); })),
        data_(make_data(data_baud, [](ByteView) {})),
        firmware_([this](const std::string& text) { cli_->send(bytes_of(text)); },
                  [this](const std::string& raw) { data_->send(bytes_of(raw)); }, options.sdk,
                  options.board == "isk" ? RadarDemo::dsp : RadarDemo::accelerator),
        frame_timer_(loop),
        output_timer_(loop),
        rng_(make_rng(options.seed, 2)),
        antennas_(player.conditions(), options.seed, options.board),
        plug_(options.plug),
        injector_(loop, player, "radar", options.plan, options.seed, [this] { poll(); }) {
    firmware_.boot();
  }

  void stop() override {
    frame_timer_.cancel();
    output_timer_.cancel();
    injector_.stop();
    cli_->close();
    data_->close();
  }

  std::vector<std::pair<std::string, std::uint64_t>> sent() const override {
    return {{"frames", frames_},
            {"frames_skipped", skipped_},
            {"data_bytes", data_->sent()},
            {"data_bytes_lost", data_->lost()},
            {"cli_bytes", cli_->sent()},
            {"cli_bytes_lost", cli_->lost()},
            {"radiates", firmware_.running() ? 1u : 0u}};
  }

 private:
  const Chirp& chirp() const { return *firmware_.running(); }

  void on_command_bytes(ByteView bytes) {
    firmware_.receive(bytes);
    data_->set_baud(firmware_.data_baud());
    if (firmware_.running() && !framing_) begin();
  }

  void begin() {
    framing_ = true;
    frames_of_start_ = 0;
    axis_ = chirp().axis(player_.conditions());
    mean_peak_ = mean_peak_power(axis_, player_.conditions());
    antennas_.start(firmware_.subframes().front(), mean_peak_);
    subframe_ = 0;
    last_profile_.clear();
    next_frame_ = player_.now();
    frame();
  }

  void frame() {
    if (subframe_ == 0) firmware_.between_frames();
    framing_ = firmware_.running().has_value();
    if (!framing_) return;
    if (subframe_ > 0 || chirp().frames == 0 || frames_of_start_ < chirp().frames) {
      // All subframes of a frame have the same frame number.
      frame_number_ += subframe_ == 0;
      frames_of_start_ += subframe_ == 0;
      sampled_s_ = player_.now_s();
      sampled_subframe_ = subframe_;
      const double ready_us = std::min(chirp().active_us() + processing_us, 0.8 * period_us());
      output_timer_.at(next_frame_ + microseconds(ready_us), [this] { output(); });
    }
    subframe_ = (subframe_ + 1) % firmware_.subframes().size();
    next_frame_ += microseconds(period_us());
    frame_timer_.at(next_frame_, [this] { frame(); });
  }

  double period_us() const { return 1e3 * chirp().frame_period_ms; }

  void output() {
    // The previous frame is still being sent. The demo firmware skips the new frame in this case.
    if (!data_->idle()) {
      ++skipped_;
      log(injector_.now(), "skipped", {frame_number_});
      return;
    }
    std::vector<RadarTlv> tlvs;
    const RadarOutputs& expected = firmware_.outputs();
    if (expected.objects) tlvs.push_back(objects_tlv());
    if (last_profile_.empty() || !injector_.active(FaultKind::freeze)) sample_frame();
    if (expected.range_profile) tlvs.push_back(range_profile_tlv(last_profile_));
    if (expected.heat_map) tlvs.push_back(last_heat_map_);
    if (expected.stats) {
      tlvs.push_back(stats_tlv(stats()));
      tlvs.push_back(temperature_tlv(temperature()));
    }
    const double now_s = player_.now_s();
    const auto cycles =
        static_cast<std::int64_t>((now_s + injector_.clock_error_s(now_s)) * cpu_hz);
    const Bytes wire = radar_frame({frame_number_, static_cast<std::uint32_t>(cycles), 0,
                                    static_cast<std::uint32_t>(sampled_subframe_)},
                                   tlvs, rng_);
    put_on_line(wire);
    ++frames_;
    transmit_us_ = static_cast<double>(wire.size()) * 1e7 / firmware_.data_baud();
    if (expected.measure_bias) report_bias(received_power());
  }

  std::vector<double> received_power() {
    auto power = radar_power(player_.at(sampled_s_).radar, axis_);
    for (double& p : power) p *= injector_.gain();
    return power;
  }

  // Computes the range profile and, if requested, the heat map. Coherent echoes need antenna
  // samples for each frame, because people move.
  void sample_frame() {
    const Conditions& c = player_.conditions();
    const bool heat_map = firmware_.outputs().heat_map, coherent = c.radar_sum == "coherent";
    if (heat_map || coherent)
      antennas_.sample_frame(player_.at(sampled_s_), sampled_s_, injector_.gain(), rng_);
    if (heat_map) last_heat_map_ = antennas_.tlv();
    last_profile_ =
        coherent ? antennas_.profile_codes()
                 : range_profile_codes(received_power(), mean_peak_, chirp().antennas, c, rng_);
  }

  void put_on_line(Bytes wire) {
    FrameIdentity what{frame_number_, crc32c(wire)};
    QueuedFrame frame{std::move(wire), what, injector_.due()};
    if (injector_.triggers(FaultKind::drop)) return log(injector_.now(), "dropped", what);
    if (injector_.triggers(FaultKind::corrupt))
      frame.what.damage = static_cast<std::int64_t>(injector_.corrupt(frame.wire));
    frame.junk = injector_.garbage();
    line_.push_back(std::move(frame));
    send_due();
  }

  void send_due() {
    for (; !line_.empty() && line_.front().due <= injector_.now(); line_.pop_front()) {
      const QueuedFrame& frame = line_.front();
      data_->send(frame.wire, [this, begun = injector_.now(), what = frame.what](bool arrived) {
        log(begun, !arrived ? "lost" : what.damage < 0 ? "sent" : "corrupt", what);
      });
      data_->send(frame.junk);
    }
  }

  void poll() {
    plug_(!injector_.active(FaultKind::unplug));
    for (const auto& uart : {cli_.get(), data_.get()})
      uart->hold(injector_.active(FaultKind::stall));
    send_due();
  }

  struct FrameIdentity {
    std::uint32_t number = 0, crc = 0;
    // Index of the byte changed by a `corrupt` fault; -1: no byte is changed.
    std::int64_t damage = -1;
  };
  void log(HostTime begun, const char* done, const FrameIdentity& what) {
    injector_.log(begun, done,
                  {{"frame", what.number}, {"damage", what.damage}, {"crc", what.crc}});
  }

  // Returns the statistics TLV. Its transmission time and margin are those of the previous frame,
  // because the current frame has not yet been sent.
  RadarStats stats() const {
    const double margin_us = period_us() - chirp().active_us() - processing_us - transmit_us_;
    RadarStats s{};
    s.inter_frame_processing_us = static_cast<std::uint32_t>(processing_us);
    s.transmit_us = static_cast<std::uint32_t>(transmit_us_);
    s.inter_frame_margin_us = static_cast<std::uint32_t>(std::max(0.0, margin_us));
    s.inter_chirp_margin_us = static_cast<std::uint32_t>(chirp().idle_us);
    s.active_frame_load_percent = 20;
    s.inter_frame_load_percent = 5;
    return s;
  }

  RadarTemperature temperature() {
    RadarTemperature t{};
    t.time_ms = static_cast<std::uint32_t>(player_.now_s() * 1e3);
    for (auto& c : t.celsius) c = static_cast<std::int16_t>(44 + rng_() % 4);
    return t;
  }

  void report_bias(const std::vector<double>& power) {
    const RadarOutputs& expected = firmware_.outputs();
    const double bias_m = measured_range_bias_m(power, chirp().firmware_step_m(), expected.target_m,
                                                expected.search_m);
    firmware_.say(format("compRangeBiasAndRxChanPhase %.7f", bias_m) + antennas_.coefficients() +
                  "\n");
  }

  struct QueuedFrame {
    Bytes wire;
    FrameIdentity what;
    HostTime due;
    Bytes junk{};  // random bytes sent after the frame (`garbage` fault)
  };

  ScenePlayer& player_;
  std::unique_ptr<Uart> cli_, data_;
  RadarFirmware firmware_;
  port::Timer frame_timer_, output_timer_;
  Rng rng_;
  RadarAntennas antennas_;
  RadarAxis axis_;
  std::vector<std::uint16_t> last_profile_;
  RadarTlv last_heat_map_;
  HostTime next_frame_{};
  double mean_peak_ = 0, sampled_s_ = 0, transmit_us_ = 0;
  bool framing_ = false;
  std::uint32_t frame_number_ = 0;
  // Index of the subframe to start next, and of the subframe to send next.
  std::size_t subframe_ = 0, sampled_subframe_ = 0;
  std::uint64_t frames_of_start_ = 0, frames_ = 0, skipped_ = 0;
  std::deque<QueuedFrame> line_;  // frames that are not yet due
  std::function<void(bool in)> plug_;
  FaultInjector injector_;
};

}  // namespace

std::unique_ptr<Device> make_radar_board(port::Loop& loop, ScenePlayer& player,
                                         const RadarBoardOptions& options, const MakeUart& make_cli,
                                         const MakeUart& make_data) {
  return std::make_unique<RadarBoard>(loop, player, options, make_cli, make_data);
}

}  // namespace echofuse::sim
