// SPDX-License-Identifier: MIT
#include "drivers/radar/radar_driver.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace echofuse::radar {
namespace {
// If a port was unplugged for longer than this, the whole cfg is sent, because another program may
// have changed the board's settings.
constexpr std::chrono::seconds cfg_keeps{10};
// A frame is considered complete if no further byte arrives within this time. USB bridges delay
// bytes by up to 16 ms.
constexpr std::chrono::milliseconds quiet{20};
// A stopped board still sends the rest of one frame, which USB bridges may delay. A second frame,
// or any frame that arrives after the longest possible transmission, is from another board.
constexpr std::chrono::milliseconds held_back{50}, longest_transmission{250}, min_pause{300};

// Returns the time within which a board with this frame period would send two frames.
std::chrono::milliseconds pause_for(double frame_period_s) {
  return std::max(min_pause,
                  held_back + std::chrono::milliseconds(std::lround(2100 * frame_period_s)));
}
}  // namespace

RadarDriver::RadarDriver(port::Loop& loop, RadarSetup setup)
    : setup_(std::move(setup)),
      loop_(loop),
      profile_(parse_profile(setup_.cfg_text, setup_.cfg_name, setup_.data_baud, setup_.board)),
      dialogue_timer_(loop),
      watch_timer_(loop),
      quiet_timer_(loop),
      backoff_(setup_.backoff),
      parser_(profile_.antennas) {
  setup_.timeouts.pause = pause_for(profile_.frame_period_s);
  info_.sensor = Sensor::radar;
  info_.address = setup_.address;
  info_.axes = {radar_axis(profile_)};
  if (!profile_.array.empty()) info_.axes.push_back(array_axis(profile_));
}

void RadarDriver::start(SampleSink& sink) {
  sink_ = &sink;
  running_ = true;
  stop_dialogue_.reset();
  for (const auto& warnings : {profile_.warnings, setup_.warnings})
    for (const std::string& warning : warnings)
      sink_->on_event(Sensor::radar, Severity::warning, warning);
  sink_->on_state(Sensor::radar, DeviceState::connecting, info_);
  connect();
}

void RadarDriver::stop() {
  if (!std::exchange(running_, false)) return;
  const bool connected = cli_ && dialogue_;
  if (!connected || setup_.keep_running) return disconnect();
  stop_timers();
  drop_data();  // later bytes are neither parsed nor captured
  stop_dialogue_.emplace(dialogue_->state() == CommandDialogue::State::commanding);
  advance_stop_dialogue();
}

void RadarDriver::advance_stop_dialogue() {
  send(stop_dialogue_->take_output());
  if (stop_dialogue_->done()) disconnect();
}

std::vector<Counter> RadarDriver::counters() const {
  std::vector<Counter> all = counters_of(parser_.counts());
  all.insert(all.end(), {{"bad_arrays", bad_arrays_},
                         {"port_losses", port_losses_},
                         {"early_frames", early_frames_},
                         {"connections", connections_},
                         {"configured", configured_},
                         {"restarted", restarted_}});
  return all;
}

void RadarDriver::connect() {
  open_ports_ = 0;
  dialogue_.reset();
  no_data_probe_.reset();
  frame_after_stop_.reset();
  cli_ = setup_.cli();
  data_ = setup_.data();
  const auto opened = [this] { on_opened(); };
  const auto disconnected = [this](const Failure& failure) { on_disconnected(failure); };
  const auto warning = [this](const std::string& text, std::uint64_t losses) {
    port_losses_ += losses;
    if (reported_.insert(text).second) sink_->on_event(Sensor::radar, Severity::warning, text);
  };
  cli_->open({opened, [this](ByteView bytes) { on_cli(bytes); }, disconnected, warning});
  data_->open({opened, [this](ByteView bytes) { on_data(bytes); }, disconnected, warning});
}

void RadarDriver::on_opened() {
  if (++open_ports_ < 2) return;
  ++connections_;
  const bool kept = unplugged_ && loop_.now() - *unplugged_ < cfg_keeps;
  unplugged_.reset();
  using Send = CommandDialogue::Send;
  dialogue_.emplace(setup_.cfg_text, setup_.cfg_name, setup_.timeouts,
                    kept ? Send::restart : Send::cfg);
  dialogue_->start(loop_.now());
  advance();
}

// Executes the actions that the dialogue has requested.
void RadarDriver::advance() {
  for (const auto& event : dialogue_->take_events()) {
    sink_->on_event(Sensor::radar, event.severity, event.text);
    if (!running_) return;
  }
  for (const auto& bias : dialogue_->take_biases()) sink_->on_firmware_bias(bias);
  send(dialogue_->take_output());
  if (dialogue_->state() == CommandDialogue::State::failed) {
    const bool answered = dialogue_->answered();
    const std::string& failure = dialogue_->failure();
    if (answered) {
      probe_failure_ = failure;
      info_.model = dialogue_->platform();
      info_.firmware = dialogue_->firmware();
    }
    const bool before = std::exchange(answered_, answered_ || answered);
    return fail(before && !answered ? "the firmware stopped responding; reset the board" : failure);
  }
  if (const auto deadline = dialogue_->deadline())
    return dialogue_timer_.after(*deadline - loop_.now(), [this] {
      dialogue_->tick(loop_.now());
      advance();
    });
  dialogue_timer_.cancel();
}

void RadarDriver::on_cli(ByteView bytes) {
  if (stop_dialogue_) {
    stop_dialogue_->receive(bytes);
    return advance_stop_dialogue();
  }
  if (no_data_probe_) {
    no_data_probe_->receive_cli(bytes);
    return send(no_data_probe_->take_output());
  }
  if (!dialogue_) return;
  const bool before = dialogue_->state() == CommandDialogue::State::done;
  dialogue_->receive(bytes, loop_.now());
  const bool after = dialogue_->state() == CommandDialogue::State::done;
  if (after && !before) {
    ++(dialogue_->sent() == CommandDialogue::Send::cfg ? configured_ : restarted_);
    frames_before_ = parser_.counts().frames;
    bytes_before_ = parser_.counts().bytes;
    info_.model = dialogue_->platform();
    info_.firmware = dialogue_->firmware();
    alive_ = loop_.now();
    watch();
  }
  advance();
}

void RadarDriver::on_data(ByteView bytes) {
  if (!running_) return;
  if (no_data_probe_) no_data_probe_->receive_data(bytes);
  const auto take = [this](RadarFrame frame) { on_frame(std::move(frame)); };
  parser_.feed(bytes, loop_.now(), take);
  quiet_timer_.cancel();
  check_frames();
  if (data_ && parser_.in_doubt())
    quiet_timer_.after(quiet, [this, take] {
      parser_.resolve(take);
      check_frames();
    });
}

// Ends the connection if the last frames revealed a fault. Must be called after the parser has
// returned.
void RadarDriver::check_frames() {
  if (const auto fault = std::exchange(fault_, {})) fail(fault->reason, fault->state);
}

void RadarDriver::on_frame(RadarFrame frame) {
  const bool configured = dialogue_ && dialogue_->state() == CommandDialogue::State::done;
  if (!running_) return;
  if (!configured || !data_ || fault_) {
    discard(frame);
    return detect_other_board(frame);
  }
  if (board_was_reset()) {
    discard(frame);
    fault_ = {"the board was reset: frame numbers restarted"};
    return;
  }
  alive_ = loop_.now();
  probe_failure_.clear();
  backoff_.alive(alive_);
  if (!std::exchange(streaming_, true)) {
    faulted_ = false;
    sink_->on_state(Sensor::radar, DeviceState::streaming, info_);
    if (!running_) return;
  }
  check_array(frame);
  if (!running_) return;
  check_period(frame);
  if (!running_) return;
  frame.subframes = profile_.subframes;
  // Converts the arrival time to the time of the first chirp. Subtracts the durations of the
  // chirps, the firmware's processing and the transmission (25 to 96 ms with a heat map).
  const double work_s = frame.stats ? 1e-6 * frame.stats->inter_frame_processing_us : 0;
  frame.received -= from_seconds(profile_.active_s + std::min(work_s, profile_.frame_period_s) +
                                 profile_.frame_bytes * 10.0 / setup_.data_baud);
  frame.lost_before += std::exchange(discarded_, 0);
  sink_->on_radar(std::move(frame));
}

void RadarDriver::check_array(RadarFrame& frame) {
  const std::string fault = heat_map_fault(profile_, frame);
  if (fault.empty()) return;
  ++bad_arrays_;
  frame.array.clear();
  if (!std::exchange(array_reported_, true))
    sink_->on_event(Sensor::radar, Severity::warning, fault);
}

// Warns if three successive frame intervals, measured by the board's clock, differ from the frame
// period of the cfg.
void RadarDriver::check_period(const RadarFrame& frame) {
  constexpr int enough = 3;
  const FrameCount now{frame.frame_number, frame.time_cpu_cycles},
      last = std::exchange(last_frame_, now);
  if (profile_.subframes > 1 || now.number != last.number + 1 || odd_periods_ == enough) return;
  const double period_s = (now.cycles - last.cycles) / RadarFrame::clock_hz,
               expected_s = profile_.frame_period_s;
  odd_periods_ = std::abs(period_s - expected_s) > expected_s / 2 ? odd_periods_ + 1 : 0;
  if (odd_periods_ < enough) return;
  const auto ms = [](double s) { return std::to_string(std::lround(1e3 * s)) + " ms"; };
  sink_->on_event(Sensor::radar, Severity::warning,
                  "frames arrive every " + ms(period_s) + ", but the cfg requests " +
                      ms(expected_s) + ": is radar.data a port of a different board?");
}

// Drops a frame that may belong to another cfg: a frame from an earlier connection, a frame
// received before the cfg was accepted, or one received after a fault. The frame counts as lost,
// unless no cfg has been accepted yet.
void RadarDriver::discard(const RadarFrame& frame) {
  ++early_frames_;
  if (configured_ > 0) discarded_ += 1 + frame.lost_before;
}

void RadarDriver::detect_other_board(const RadarFrame& frame) {
  const auto stopped = dialogue_ && data_ ? dialogue_->stopped() : std::nullopt;
  if (!stopped || frame.received < *stopped + held_back) return;
  const std::uint32_t first = frame_after_stop_.value_or(frame.frame_number);
  frame_after_stop_ = first;
  if (frame.frame_number == first && frame.received < *stopped + longest_transmission) return;
  fault_ = {"radar.cli and radar.data are ports of two different boards: frame " +
                std::to_string(frame.frame_number) +
                " arrived although the board of radar.cli is stopped",
            DeviceState::misconfigured};
}

// Returns true if the frame numbering has restarted. Ignores a restart within the first two frames
// after a start, because a known reset may have caused it.
bool RadarDriver::board_was_reset() {
  const FrameCounts& counts = parser_.counts();
  const bool again = counts.restarts > restarts_seen_;
  restarts_seen_ = counts.restarts;
  return again && counts.frames > frames_before_ + 2;
}

void RadarDriver::watch() {
  const auto limit = std::max(from_seconds(2), from_seconds(5 * profile_.frame_period_s));
  const auto left = alive_ + limit - loop_.now();
  if (left <= left.zero())
    return streaming_ ? fail("no frames on the data port") : start_no_data_probe();
  watch_timer_.after(left, [this] { watch(); });
}

void RadarDriver::start_no_data_probe() {
  no_data_probe_.emplace(setup_.data_baud, parser_.counts().bytes - bytes_before_);
  send(no_data_probe_->take_output());
  watch_timer_.after(NoDataProbe::time, [this] {
    const std::string& remark = dialogue_->remark();
    fail(probe_failure_ = "no frames on the data port: " + no_data_probe_->cause() +
                          (remark.empty() ? "" : "; message from the board on start: " + remark));
  });
}

void RadarDriver::send(const std::string& text) {
  cli_->write({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

void RadarDriver::on_disconnected(const Failure& failure) {
  const bool worked = streaming_;
  fail(failure.text());
  if (worked) unplugged_ = loop_.now();
}

void RadarDriver::stop_timers() {
  dialogue_timer_.cancel();
  watch_timer_.cancel();
  quiet_timer_.cancel();
}

void RadarDriver::disconnect() {
  stop_timers();
  cli_.reset();
  drop_data();
  streaming_ = false;
}

void RadarDriver::drop_data() {
  data_.reset();
  parser_.finish([this](const RadarFrame& frame) { discard(frame); });
}

void RadarDriver::fail(const std::string& reason, DeviceState state) {
  if (!running_) return;
  disconnect();
  const std::string text = probe_failure_.empty() || probe_failure_ == reason
                               ? reason
                               : probe_failure_ + "; then: " + reason;
  if (backoff_.is_news(text)) sink_->on_event(Sensor::radar, Severity::warning, text);
  if (!running_) return;
  if (!std::exchange(faulted_, true) || state != DeviceState::faulted)
    sink_->on_state(Sensor::radar, state, info_);
  if (!running_) return;
  watch_timer_.after(backoff_.next(), [this] { connect(); });
}

NoDataProbe::NoDataProbe(std::uint32_t data_baud, std::uint64_t bytes)
    : data_baud_(data_baud), bytes_(bytes), output_("queryDemoStatus\n") {}

void NoDataProbe::receive_cli(ByteView bytes) {
  constexpr std::size_t longest = 512;
  for (const std::uint8_t byte : bytes) {
    if (byte == '\n' || byte == '\r' || line_.size() > longest) line_.clear();
    line_ += static_cast<char>(byte);
    runs_ = runs_ || line_.ends_with("Sensor State: 2");
    if (!line_.ends_with(":/>")) continue;
    line_.clear();
    ++answered_;
    if (answered_ == 1) output_ += "sensorStop\n";
    if (answered_ == 2) output_ += "configDataPort " + std::to_string(data_baud_) + " 1\n";
  }
}

void NoDataProbe::receive_data(ByteView bytes) {
  bytes_ += bytes.size();
  if (answered_ >= 2) pings_ += static_cast<std::size_t>(std::ranges::count(bytes, 0xff));
}

std::string NoDataProbe::take_output() { return std::exchange(output_, {}); }

std::string NoDataProbe::cause() const {
  // configDataPort sends 16 bytes 0xff (SDK 3.4); some of them may be lost
  constexpr std::size_t min_ping_bytes = 12;
  if (answered_ == 0)
    return "the firmware does not answer: its processor has stopped; reset the board, and disable "
           "outputs in guiMonitor or set a longer frame period";
  if (!runs_)
    return "the firmware reports that the sensor is stopped: reset the board; the cfg is then sent "
           "again";
  if (answered_ < 2)
    return "the sensor does not stop: its signal processor has stopped; reset the board, and "
           "disable outputs in guiMonitor or set a longer frame period";
  if (pings_ >= min_ping_bytes)
    return "the data port works, but no frame is sent: the firmware image is for a different board "
           "(ISK image on "
           "an AOP or ODS, or vice versa), or its signal processor has stopped; flash the "
           "demo for this board";
  if (bytes_ > 0)
    return std::to_string(bytes_) +
           " bytes received, but no frame; check that radar.data_baud is the baud rate of the "
           "firmware's data port";
  return "no bytes received, not even the firmware's test bytes: radar.data is "
         "the wrong port (expected the board's port with the higher interface number), or its "
         "cable is loose";
}

}  // namespace echofuse::radar
