// SPDX-License-Identifier: MIT
#include "acquire/calibrate/calibrate.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "acquire/calibrate/array_calibration.hpp"
#include "acquire/calibrate/calibrate_output.hpp"
#include "acquire/calibrate/calibration_update.hpp"
#include "acquire/calibrate/peak.hpp"
#include "acquire/calibrate/response_fit.hpp"
#include "acquire/config/calibration.hpp"
#include "acquire/devices/devices.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

// Distance by which the histogram axis extends beyond the reflector; allows for cable delays.
constexpr double spd_reach_m = 15;
constexpr std::int64_t spd_bin_ps = 10;

// Returns a histogram axis with fine bins. It starts at the sync pulse of the laser, because click
// times are relative to the preceding sync pulse.
tdc::HistogramSettings fine_axis(const Config& config, double distance_m) {
  tdc::HistogramSettings s = config.histogram;
  s.bin_width_ps = spd_bin_ps;
  s.first_bin_ps = 0;
  s.bins = static_cast<std::uint32_t>((distance_m + spd_reach_m) * ps_per_m / spd_bin_ps);
  return s;
}

class Gatherer final : public SampleSink {
 public:
  Gatherer(const Config& config, double distance_m) : histogram_(fine_axis(config, distance_m)) {}

  void on_tags(const TagBlock& block) override {
    if (block.lost_blocks + block.lost_items > 0) histogram_.forget_start();
    histogram_.add(block.tags);
  }
  void on_histogram(HistogramFrame) override { counting_board = true; }
  void on_radar(RadarFrame frame) override {
    if (!running) return;
    if (frame.power.size() == radar_axis.count) frames.push_back(std::move(frame.power));
    if (!frame.array.empty()) arrays.push_back(std::move(frame.array));
  }
  void on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) override {
    if (sensor == Sensor::spd) histogram_.forget_start();
    if (sensor == Sensor::radar && state == DeviceState::streaming && radar_axis.count == 0)
      radar_axis = info.axes.at(0);
  }
  void on_firmware_bias(const FirmwareBias& bias) override { firmware.push_back(bias); }
  // Prints warnings while the devices start. Later warnings are ignored.
  void on_event(Sensor sensor, Severity severity, const std::string& text) override {
    if (severity != Severity::info && !running) spdlog::warn("{}: {}", name_of(sensor), text);
  }

  std::vector<std::uint32_t> take() {
    counts = histogram_.tag_counts();
    return histogram_.take();
  }
  const tdc::Histogram& histogram() const { return histogram_; }

  bool running = false, counting_board = false;
  Axis radar_axis;
  TagCounts counts;
  Profiles frames;
  ArrayFrames arrays;
  std::vector<FirmwareBias> firmware;

 private:
  tdc::Histogram histogram_;
};

class Measurement {
 public:
  Measurement(const Config& config, const CalibrateOptions& options, const Reflector& reflector,
              port::Loop& loop)
      : config_(config),
        options_(options),
        reflector_(reflector),
        loop_(loop),
        gatherer_(config, reflector.distance_m),
        devices_(loop, config, gatherer_) {}

  void run() {
    devices_.take("calibrate");
    devices_.start();
    devices_.wait(config_.connect_timeout_s);
    devices_.refuse_misconfigured();
    refuse_interrupted();
    if (!devices_[Sensor::spd].delivers() && !devices_[Sensor::radar].delivers())
      throw Error(ExitCode::device, "the devices to calibrate delivered no data within " +
                                        human_duration(config_.connect_timeout_s));
    Progress progress("calibrate", static_cast<std::size_t>(options_.repeats));
    gatherer_.running = true;
    gatherer_.take();
    for (std::int64_t k = 0; k < options_.repeats; ++k) {
      listen();
      refuse_interrupted();
      end_repeat();
      progress.update(static_cast<std::size_t>(k + 1));
    }
    devices_.stop();
    if (config_.configured().contains(Sensor::radar)) fit_window();
  }
  const WindowFit& window() const { return window_; }
  const DeviceInfo& device(Sensor s) const { return devices_[s].info; }
  const Axis& radar_axis() const { return gatherer_.radar_axis; }
  std::vector<CalibrationResult> results() const {
    std::vector<CalibrationResult> out;
    if (config_.configured().contains(Sensor::spd)) out.push_back(spd());
    if (config_.configured().contains(Sensor::radar)) out.push_back(radar());
    return out;
  }
  // Returns the antenna gains and phases, without the phases caused by the reflector's direction.
  // Returns nullopt if the radar cfg does not enable the heat map.
  std::optional<AntennaFit> antennas() const {
    if (config_.antennas.empty()) return std::nullopt;
    AntennaFit fit = wave();
    const radar::RadarProfile profile = parse_profile(config_.radar);
    remove_steering(
        fit.gains, steering_of(reflector_, profile.pairs, speed_of_light_m_s / profile.carrier_hz));
    return fit;
  }
  AntennaFit wave() const {
    const Peak peak = options_.side ? echo(frames_) : radar().peak;
    AntennaFit all{.gains = {}, .snr_db = 0, .refusal = peak.refusal};
    if (!peak.refusal.empty()) return all;
    const auto fit = [&](const ArrayFrames& frames) {
      return fit_antennas(frames, config_.antennas.size(),
                          static_cast<std::size_t>(peak.range_m / echo_axis().step_m + 0.5));
    };
    ArrayFrames together;
    for (const ArrayFrames& repeat : arrays_)
      together.insert(together.end(), repeat.begin(), repeat.end());
    all = fit(together);
    std::vector<AntennaGains> repeats;
    for (const ArrayFrames& repeat : arrays_)
      if (const AntennaFit one = fit(repeat); one.refusal.empty()) repeats.push_back(one.gains);
    widen(all.gains, repeats);
    return all;
  }
  // Fits the response of each sensor to the reflector. If a value cannot be measured, adds the
  // reason to `unstated`.
  record::Response response(const std::vector<CalibrationResult>& results,
                            Unstated& unstated) const {
    record::Response out;
    const auto& s = gatherer_.histogram().settings();
    for (const CalibrationResult& r : results) {
      if (!r.peak.refusal.empty()) continue;
      if (r.sensor == Sensor::spd) {
        unstated["irf_fwhm_ps"] = fit_impulse_response(
            all_counts_, static_cast<double>(s.first_bin_ps), static_cast<double>(s.bin_width_ps),
            {r.peak.range_m, options_.search.window_m}, out);
        continue;
      }
      out.radar = radar_.radar, out.taps_standard_error = radar_.taps_standard_error;
      unstated["radar_taps"] = window_.refusal;
      unstated["radar_noise_exponent"] = fit_noise_exponent(frames_, out);
    }
    std::erase_if(unstated, [](const auto& one) { return one.second.empty(); });
    return out;
  }
  std::optional<FirmwareBias> firmware() const {
    const auto& all = gatherer_.firmware;
    if (all.empty()) return std::nullopt;
    FirmwareBias mean = all[0];
    for (std::size_t i = 1; i < all.size(); ++i) {
      if (all[i].re_im.size() != mean.re_im.size()) return std::nullopt;
      mean.range_bias_m += all[i].range_bias_m;
      for (std::size_t k = 0; k < mean.re_im.size(); ++k) mean.re_im[k] += all[i].re_im[k];
    }
    const auto n = static_cast<double>(all.size());
    mean.range_bias_m /= n;
    for (double& v : mean.re_im) v /= n;
    mean.lines = static_cast<std::int64_t>(all.size());
    return mean;
  }

 private:
  static void refuse_interrupted() {
    if (interrupted())
      throw Error(ExitCode::interrupted, "interrupted; no calibration was written");
  }
  void listen() { loop_.run_until(interrupted, loop_.now() + from_seconds(options_.time_s)); }
  Search search_of(Sensor sensor) const {
    // Width of the search window; large, because the reflector is moved by hand.
    constexpr double side_window_m = 0.4;
    if (options_.side)
      return {place_at(*options_.side, reflector_, config_.calibration.antennas.sine).range_m +
                  stored_offset_m(),
              side_window_m};
    return {reflector_.range_m(sensor), options_.search.window_m};
  }
  double stored_offset_m() const {
    const auto* entry = config_.calibration.find(Sensor::radar);
    return entry ? entry->offset_m : 0;
  }
  CalibrationResult result_of(Sensor sensor, Peak peak, double spread_m, const char* method) const {
    return {sensor,
            std::move(peak),
            spread_m,
            method,
            reflector_.range_m(sensor),
            reflector_.error_m(sensor)};
  }
  Peak photons(std::span<const std::uint32_t> counts) const {
    const auto& s = gatherer_.histogram().settings();
    return fit_photons(counts, static_cast<double>(s.first_bin_ps),
                       static_cast<double>(s.bin_width_ps), search_of(Sensor::spd));
  }
  EchoAxis echo_axis() const {
    const Axis& axis = gatherer_.radar_axis;
    if (is_bridged()) return {.step_m = axis.step, .start_m = axis.start};
    const radar::RadarProfile profile = parse_profile(config_.radar);
    return {.step_m = profile.range_step_m, .resolution_m = profile.resolution_m};
  }
  bool is_bridged() const { return !config_.radar.address.empty(); }
  Peak echo(const Profiles& frames, std::size_t min_frames = min_echo_frames) const {
    return fit_echo(frames, echo_axis(), search_of(Sensor::radar), window_.window, min_frames);
  }
  // Fits the echo of each repeat. The fit uses the window that was measured with the reflector, or
  // a Blackman window if that measurement failed.
  void fit_window() {
    for (const Profiles& some : repeats_) frames_.insert(frames_.end(), some.begin(), some.end());
    if (is_bridged())
      window_.refusal = "the bandwidth of a radar behind a bridge is unknown";
    else
      window_ = fit_radar_response(frames_, echo_axis(), echo(frames_).range_m, radar_);
    for (const Profiles& some : repeats_)
      if (const Peak one = echo(some, 2); one.refusal.empty()) radar_ranges_.push_back(one.range_m);
  }
  void end_repeat() {
    arrays_.push_back(std::exchange(gatherer_.arrays, {}));
    const auto counts = gatherer_.take();
    starts_ += gatherer_.counts.starts;
    clicks_ += gatherer_.counts.in_range;
    all_counts_.resize(counts.size());
    for (std::size_t i = 0; i < counts.size(); ++i) all_counts_[i] += counts[i];
    const Peak spd = photons(counts);
    if (spd.refusal.empty()) spd_ranges_.push_back(spd.range_m);
    repeats_.push_back(std::exchange(gatherer_.frames, {}));
  }
  // Rejects the peak if it was found in fewer than three repeats or in fewer than half of the
  // repeats, because the spread of so few ranges is unreliable.
  void refuse_few(Peak& peak, std::size_t measured) const {
    const auto required = static_cast<std::size_t>(std::max<std::int64_t>(3, options_.repeats / 2));
    if (!peak.refusal.empty() || measured >= required) return;
    peak.refusal = "only " + std::to_string(measured) + " of " + std::to_string(options_.repeats) +
                   " repeats show the peak (at least " + std::to_string(required) +
                   " needed); try a longer --time";
  }
  CalibrationResult spd() const {
    CalibrationResult r = result_of(Sensor::spd, photons(all_counts_), spread_of(spd_ranges_),
                                    "Gaussian by maximum likelihood");
    const double a_pulse =
        gatherer_.histogram().gaps().clicks_per_pulse(clicks_, starts_).value_or(0);
    if (r.peak.refusal.empty() && a_pulse > record::max_clicks_per_pulse)
      r.peak.refusal = "saturated: more than one click per 20 laser pulses; attenuate the light";
    if (gatherer_.counting_board)
      r.peak.refusal = "the sensor sends histograms; calibrate supports time taggers only";
    refuse_few(r.peak, spd_ranges_.size());
    if (!devices_[Sensor::spd].delivers()) r.peak.refusal = devices_.describe(Sensor::spd);
    r.peak.standard_error_m = honest_error(r.peak.standard_error_m, spd_ranges_);
    return r;
  }
  CalibrationResult radar() const {
    CalibrationResult r =
        result_of(Sensor::radar, echo(frames_), spread_of(radar_ranges_),
                  is_bridged() ? "parabola of the log power" : "least squares of the lobe");
    if (r.peak.refusal.empty() || r.peak.outside)
      if (const auto why = other_mounting(reflector_, r.peak.range_m, options_.search.window_m);
          !why.empty())
        r.peak.refusal = why;
    refuse_few(r.peak, radar_ranges_.size());
    if (!devices_[Sensor::radar].delivers()) r.peak.refusal = devices_.describe(Sensor::radar);
    r.peak.standard_error_m =
        std::hypot(honest_error(r.peak.standard_error_m, radar_ranges_), window_.zero_error_m);
    return r;
  }

  const Config& config_;
  const CalibrateOptions& options_;
  const Reflector& reflector_;
  port::Loop& loop_;
  Gatherer gatherer_;
  Devices devices_;
  std::vector<std::uint32_t> all_counts_;
  std::uint64_t starts_ = 0, clicks_ = 0;
  std::vector<Profiles> repeats_;
  Profiles frames_;
  WindowFit window_;
  record::Response radar_;
  std::vector<double> spd_ranges_, radar_ranges_;
  std::vector<ArrayFrames> arrays_;
};

Calibration to_calibration(const std::vector<CalibrationResult>& results,
                           const std::optional<AntennaFit>& antennas,
                           const record::Response& response, const Reflector& reflector,
                           const std::optional<FirmwareBias>& firmware, const Clock& clock) {
  Calibration out;
  for (const CalibrationResult& r : results)
    if (r.peak.refusal.empty())
      out.entries.push_back({.sensor = r.sensor,
                             .date_utc = iso8601(clock.utc()),
                             .method = r.method,
                             .distance_m = r.true_range_m,
                             .offset_m = r.offset_m(),
                             .standard_error_m = r.standard_error_m()});
  out.baseline_m = reflector.baseline_m;
  out.firmware = firmware;
  out.response = response;
  if (!antennas || !antennas->refusal.empty()) return out;
  out.antennas = antennas->gains;
  out.antennas.date_utc = iso8601(clock.utc());
  out.antennas.distance_m = reflector.range_m(Sensor::radar);
  return out;
}

Config with_chosen(const Config& all, const CalibrateOptions& options) {
  Config config = all;
  const auto only = options.side ? std::optional(Sensor::radar) : options.only;
  if (only == Sensor::radar) config.tdc.address.clear();
  if (only == Sensor::spd) config.radar = {}, config.antennas.clear();
  return config;
}

void print(nlohmann::ordered_json json) {
  json["schema"] = 1;
  std::printf("%s\n",
              json.dump(-1, ' ', true, nlohmann::ordered_json::error_handler_t::replace).c_str());
}

ExitCode finish(const Measurement& measurement, const Config& config,
                const CalibrateOptions& options, const Reflector& reflector,
                const Calibration& stored, const Clock& clock) {
  const auto results = measurement.results();
  nlohmann::ordered_json json{{"distance_m", reflector.distance_m},
                              {"reflector", name_of(reflector.mounting)},
                              {"baseline_m", reflector.baseline_m},
                              {"repeats", options.repeats}};
  bool refused = false;
  for (const CalibrationResult& r : results) {
    json["sensors"].push_back(json_of(r));
    if (!options.json) print_text(r);
    refused = refused || !r.peak.refusal.empty();
  }
  const auto antennas = measurement.antennas();
  if (antennas) {
    json["array"] = json_of(*antennas);
    if (!options.json) std::printf("%s", to_text(*antennas).c_str());
    refused = refused || !antennas->refusal.empty();
  }
  Unstated unstated;
  const record::Response response = measurement.response(results, unstated);
  for (const auto& [key, why] : unstated) json["unstated"][key] = why;
  for (const auto& [key, text] : response.meta()) json["response"][key] = text;
  if (response.radar.known()) json["lopsided"] = json_of(measurement.window());
  if (!options.json) print_text(response, unstated);
  if (!options.json && response.radar.known()) print_text(measurement.window());
  Calibration fresh =
      to_calibration(results, antennas, response, reflector, measurement.firmware(), clock);
  if (fresh.find(Sensor::spd)) fresh.axes.spd = tdc::Histogram(config.histogram).axis();
  if (fresh.find(Sensor::radar)) fresh.axes.radar = measurement.radar_axis();
  for (auto& entry : fresh.entries) {
    entry.model = measurement.device(entry.sensor).model;
    entry.serial = measurement.device(entry.sensor).serial;
  }
  bool well = true;
  if (options.check) {
    well = compare(fresh, stored, json, options.json);
  } else if (!fresh.entries.empty()) {
    store(fresh, stored, config.calibration_path, json, options.json);
  }
  if (options.json) print(json);
  return refused ? ExitCode::device : well ? ExitCode::ok : ExitCode::failed;
}

ExitCode check_side(const Config& config, const CalibrateOptions& options,
                    const Reflector& reflector, port::Loop& loop) {
  const AntennaGains& calibrated = config.calibration.antennas;
  if (calibrated.empty() || config.antennas.empty())
    throw Error(ExitCode::config,
                "--side needs a radar.cfg that sends antenna samples and a "
                "run.calibration with antenna gains and phases");
  const SidePlace place = place_at(*options.side, reflector, calibrated.sine);
  if (!options.json)
    std::printf("expected reflector position: x = %+.2f m, z = %.2f m, %.3f m from the radar\n",
                place.x_m, reflector.distance_m, place.range_m);
  std::fflush(stdout);
  Measurement measurement(config, options, reflector, loop);
  measurement.run();
  const AntennaFit wave = measurement.wave();
  SideFinding found;
  found.refusal = wave.refusal;
  const radar::RadarProfile profile = parse_profile(config.radar);
  if (wave.refusal.empty())
    found = find_side(*options.side, reflector, wave.gains, calibrated, profile.pairs,
                      speed_of_light_m_s / profile.carrier_hz);
  if (!options.json)
    std::printf("%s", to_text(*options.side, found).c_str());
  else if (!found.refusal.empty())
    print({{"refusal", found.refusal}});
  else
    print({{"sine", found.sine}, {"expected", found.expected}, {"swapped", found.swapped}});
  return !found.refusal.empty() ? ExitCode::device
         : found.swapped        ? ExitCode::failed
                                : ExitCode::ok;
}

void announce(const Config& config, const Reflector& reflector, double window_m) {
  std::printf("reflector %.3f m in front of %s\n", reflector.distance_m,
              reflector.mounting == Mounting::detector ? "the detector" : "each sensor");
  for (const Sensor sensor : {Sensor::spd, Sensor::radar})
    if (config.configured().contains(sensor))
      std::printf("%-6s expected at %.3f m, search window %.3f to %.3f m\n", name_of(sensor),
                  reflector.range_m(sensor), reflector.range_m(sensor) - window_m / 2,
                  reflector.range_m(sensor) + window_m / 2);
  std::fflush(stdout);
}

// Returns the options with the reflector distance of the stored calibration, unless it is given. A
// reflector in front of the detector is farther from the radar, and the file states that distance.
CalibrateOptions with_stored_distance(CalibrateOptions options, const Calibration& stored) {
  if (options.distance_given || !(options.side || options.check)) return options;
  const auto* entry = stored.find(Sensor::spd);
  if (!entry) entry = stored.find(Sensor::radar);
  if (!entry) return options;
  const bool across = entry->sensor == Sensor::radar && options.mounting == Mounting::detector;
  const double lateral_m = across ? stored.baseline_m : 0;
  options.search.distance_m =
      std::sqrt(std::max(0.0, std::pow(entry->distance_m, 2) - std::pow(lateral_m, 2)));
  return options;
}

}  // namespace

ExitCode calibrate(const Config& all, const CalibrateOptions& given, port::Loop& loop) {
  const Config config = with_chosen(all, given);
  const Calibration stored =
      given.check || given.side ? config.calibration : stored_in(config.calibration_path);
  const CalibrateOptions options = with_stored_distance(given, stored);
  if ((config.configured() - SensorSet{Sensor::depth}).empty())
    throw Error(ExitCode::config,
                std::string("nothing to calibrate; set tdc.address, radar.cli or radar.address") +
                    (options.only ? ", or remove --only" : ""));
  if (options.check && config.calibration.entries.empty())
    throw Error(
        ExitCode::config,
        "--check: run.calibration contains nothing to compare with; set run.calibration to a "
        "calibration file");
  const Reflector reflector{.mounting = options.mounting,
                            .distance_m = options.search.distance_m,
                            .baseline_m = config.baseline_m,
                            .distance_error_m = options.distance_error_m,
                            .baseline_error_m = options.baseline_error_m};
  if (options.side) return check_side(config, options, reflector, loop);
  if (!options.json) announce(config, reflector, options.search.window_m);
  Measurement measurement(config, options, reflector, loop);
  measurement.run();
  return finish(measurement, config, options, reflector, stored, loop);
}

}  // namespace echofuse::acquire
