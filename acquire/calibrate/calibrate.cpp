// SPDX-License-Identifier: MIT
#include "acquire/calibrate/calibrate.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "acquire/calibrate/array_calibration.hpp"
#include "acquire/calibrate/calibrate_output.hpp"
#include "acquire/calibrate/peak.hpp"
#include "acquire/calibrate/response_fit.hpp"
#include "acquire/config/calibration.hpp"
#include "acquire/devices/devices.hpp"
#include "drivers/core/log2_codes.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr double spd_reach_m = 15;  // beyond the reflector: cables delay by metres
constexpr std::int64_t spd_bin_ps = 10;

// Axis that starts at the laser's sync: a click counts from the last sync before it.
tdc::HistogramSettings fine_axis(const Config& config, const Search& search) {
  tdc::HistogramSettings s = config.histogram;
  s.bin_width_ps = spd_bin_ps;
  s.first_bin_ps = 0;
  s.bins = static_cast<std::uint32_t>((search.distance_m + spd_reach_m) * ps_per_m / spd_bin_ps);
  return s;
}

// Collects the samples of a repeat.
class Gatherer final : public SampleSink {
 public:
  Gatherer(const Config& config, const Search& search)
      : bins_(config.configured().contains(Sensor::radar) ? parse_profile(config.radar).bins : 0),
        histogram_(fine_axis(config, search)) {}

  void on_tags(const TagBlock& block) override {
    if (block.lost_blocks + block.lost_items > 0) histogram_.forget_start();
    histogram_.add(block.tags);
  }
  void on_radar(RadarFrame frame) override {
    if (!running) return;
    if (frame.range_profile.size() == bins_) frames.push_back(std::move(frame.range_profile));
    if (!frame.array.empty()) arrays.push_back(std::move(frame.array));
  }
  void on_state(Sensor sensor, DeviceState, const DeviceInfo&) override {
    if (sensor == Sensor::spd) histogram_.forget_start();
  }
  void on_firmware_bias(const FirmwareBias& bias) override { firmware.push_back(bias); }
  // Warns at once while the user waits for the devices.
  void on_event(Sensor sensor, Severity severity, const std::string& text) override {
    if (severity != Severity::info && !running) spdlog::warn("{}: {}", name_of(sensor), text);
  }

  // Counts since the last call.
  std::vector<std::uint32_t> take() {
    counts = histogram_.tag_counts();
    return histogram_.take();
  }
  const tdc::Histogram& histogram() const { return histogram_; }

  bool running = false;
  TagCounts counts;
  std::vector<std::vector<std::uint16_t>> frames;
  ArrayFrames arrays;  // cleared with each repeat
  std::vector<FirmwareBias> firmware;

 private:
  std::size_t bins_;  // bins of a whole profile
  tdc::Histogram histogram_;
};

class Measurement {
 public:
  Measurement(const Config& config, const CalibrateOptions& options, port::Loop& loop)
      : config_(config),
        options_(options),
        loop_(loop),
        gatherer_(config, options.search),
        devices_(loop, config, gatherer_) {}

  void run() {
    devices_.take("calibrate");
    devices_.start();
    devices_.wait(config_.connect_timeout_s);
    refuse_interrupted();
    if (!devices_[Sensor::spd].delivers() && !devices_[Sensor::radar].delivers())
      throw Error(ExitCode::device, "no device to calibrate delivers after " +
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
  const DeviceInfo& device(Sensor s) const { return devices_[s].info; }
  std::vector<CalibrationResult> results() const {
    std::vector<CalibrationResult> out;
    if (config_.configured().contains(Sensor::spd)) out.push_back(spd());
    if (config_.configured().contains(Sensor::radar)) out.push_back(radar());
    return out;
  }
  // None if the cfg asks for no heat map. Known by the range that the profile has of the reflector.
  std::optional<AntennaFit> antennas() const {
    if (config_.antennas.empty()) return std::nullopt;
    const Peak peak = radar().peak;
    AntennaFit all{.gains = {}, .snr_db = 0, .refusal = "the range profile has no such peak"};
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
  // Response of the instruments to the reflector; `unstated` gets why a value is missing.
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
      unstated["radar_noise_exponent"] =
          fit_noise_exponent(frames_, echo_axis().log2_power_step, out);
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
  Peak photons(std::span<const std::uint32_t> counts) const {
    const auto& s = gatherer_.histogram().settings();
    return fit_photons(counts, static_cast<double>(s.first_bin_ps),
                       static_cast<double>(s.bin_width_ps), options_.search);
  }
  using Frames = std::vector<std::vector<std::uint16_t>>;
  EchoAxis echo_axis() const {
    const radar::RadarProfile profile = parse_profile(config_.radar);
    // step = 3e8 fs / (2 slope FFT size): the sampled sweep is adc_samples of the FFT's points.
    const double resolution_m = profile.range_step_m * std::bit_ceil(profile.adc_samples) /
                                profile.adc_samples * speed_of_light_m_s / 3.0e8;
    return {.step_m = profile.range_step_m,
            .resolution_m = resolution_m,
            .log2_power_step = log2_power_step(profile.antennas)};
  }
  Peak echo(const Frames& frames) const {
    return fit_echo(frames, echo_axis(), options_.search, window_.window);
  }
  // Places every echo by the window that the reflector shows; by Blackman's if it shows none.
  void fit_window() {
    for (const Frames& some : repeats_) frames_.insert(frames_.end(), some.begin(), some.end());
    window_ = fit_radar_response(frames_, echo_axis(), echo(frames_).range_m, radar_);
    for (const Frames& some : repeats_)
      if (const Peak one = echo(some); one.refusal.empty()) radar_ranges_.push_back(one.range_m);
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
  CalibrationResult spd() const {
    CalibrationResult r{Sensor::spd, photons(all_counts_), spread_of(spd_ranges_),
                        "Gaussian by maximum likelihood"};
    const double a_pulse =
        gatherer_.histogram().gaps().clicks_a_pulse(clicks_, starts_).value_or(0);
    if (r.peak.refusal.empty() && a_pulse > record::most_clicks_a_pulse)
      r.peak.refusal = "saturated: more than one click in 20 laser pulses; attenuate the light";
    if (!devices_[Sensor::spd].delivers()) r.peak.refusal = devices_.describe(Sensor::spd);
    r.peak.standard_error_m = honest_error(r.peak.standard_error_m, spd_ranges_);
    return r;
  }
  CalibrationResult radar() const {
    CalibrationResult r{Sensor::radar, echo(frames_), spread_of(radar_ranges_),
                        "least squares of the lobe"};
    if (!devices_[Sensor::radar].delivers()) r.peak.refusal = devices_.describe(Sensor::radar);
    r.peak.standard_error_m = honest_error(r.peak.standard_error_m, radar_ranges_);
    return r;
  }

  const Config& config_;
  const CalibrateOptions& options_;
  port::Loop& loop_;
  Gatherer gatherer_;
  Devices devices_;
  std::vector<std::uint32_t> all_counts_;
  std::uint64_t starts_ = 0, clicks_ = 0;
  std::vector<Frames> repeats_;
  Frames frames_;  // frames of all repeats
  WindowFit window_;
  record::Response radar_;
  std::vector<double> spd_ranges_, radar_ranges_;
  std::vector<ArrayFrames> arrays_;  // by repeat
};

Calibration to_calibration(const std::vector<CalibrationResult>& results,
                           const std::optional<AntennaFit>& antennas,
                           const record::Response& response, const CalibrateOptions& options,
                           const std::optional<FirmwareBias>& firmware, const Clock& clock) {
  Calibration out;
  for (const CalibrationResult& r : results)
    if (r.peak.refusal.empty())
      out.entries.push_back({.sensor = r.sensor,
                             .date_utc = iso8601(clock.utc()),
                             .method = r.method,
                             .distance_m = options.search.distance_m,
                             .offset_m = r.peak.range_m - options.search.distance_m,
                             .standard_error_m = r.peak.standard_error_m});
  out.firmware = firmware;
  out.response = response;
  if (!antennas || !antennas->refusal.empty()) return out;
  out.antennas = antennas->gains;
  out.antennas.date_utc = iso8601(clock.utc());
  out.antennas.distance_m = options.search.distance_m;
  return out;
}

// One of many antennas is four standard errors off more seldom than one range is three.
bool compare_antennas(const AntennaGains& now, const AntennaGains& then,
                      nlohmann::ordered_json& json, bool quiet) {
  if (now.empty()) return true;
  const bool same = now.gain.size() == then.gain.size();
  const double worst = largest_residual(now, then);
  const bool holds = same && worst <= 4;
  json["array_residual"] = {{"standard_errors", worst}, {"holds", holds}};
  if (!quiet && !same)
    std::printf("array  the calibration has %zu antennas; calibrate anew\n", then.gain.size());
  else if (!quiet)
    std::printf("array  differs by at most %.1f standard errors: the calibration of %s %s\n", worst,
                then.date_utc.c_str(), holds ? "holds" : "has slipped; calibrate anew");
  return holds;
}

// Residuals against the stored calibration. False: one is more than three of its standard errors.
bool compare(const Calibration& fresh, const Calibration& stored, nlohmann::ordered_json& json,
             bool quiet) {
  bool well = true;
  for (const auto& now : fresh.entries) {
    const auto* then = stored.find(now.sensor);
    if (!then) continue;
    const double residual = now.offset_m - then->offset_m;
    const double error = std::hypot(now.standard_error_m, then->standard_error_m);
    const bool holds = std::abs(residual) <= 3 * error;
    well = well && holds;
    json["residuals"].push_back({{"sensor", name_of(now.sensor)},
                                 {"residual_m", residual},
                                 {"standard_error_m", error},
                                 {"holds", holds}});
    if (!quiet)
      std::printf("%-6s residual %+.2f mm +- %.2f mm: the calibration of %s %s\n",
                  name_of(now.sensor), 1e3 * residual, 1e3 * error, then->date_utc.c_str(),
                  holds ? "holds" : "has slipped; calibrate anew");
  }
  return compare_antennas(fresh.antennas, stored.antennas, json, quiet) && well;
}

// Calibration that the target file holds already; never overwritten unread.
Calibration stored_in(const std::string& path) {
  std::error_code none;
  if (!std::filesystem::exists(path, none)) return {};
  try {
    return read_calibration(path);
  } catch (const Error& e) {
    throw Error(
        e.code(),
        std::string(e.what()) + "\n" + path +
            " is not overwritten; to begin anew, remove it or name another run.calibration");
  }
}

void store(const Calibration& fresh, const Calibration& stored, const std::string& path,
           nlohmann::ordered_json& json, bool quiet) {
  write_calibration(path, fresh.over(stored));
  json["file"] = path;
  for (const auto& e : stored.entries) {
    if (fresh.find(e.sensor)) continue;
    json["kept"].push_back(
        {{"sensor", name_of(e.sensor)}, {"offset_m", e.offset_m}, {"date_utc", e.date_utc}});
    if (!quiet)
      std::printf("%-6s kept: offset %+.2f mm of %s\n", name_of(e.sensor), 1e3 * e.offset_m,
                  e.date_utc.c_str());
  }
  if (!quiet) std::printf("written to %s\n", printable(path).c_str());
}

}  // namespace

ExitCode calibrate(const Config& config, const CalibrateOptions& options, port::Loop& loop) {
  if ((config.configured() - SensorSet{Sensor::depth}).empty())
    throw Error(ExitCode::config,
                "neither tdc.address nor radar.cli is given: nothing to calibrate");
  if (!config.radar.address.empty())
    throw Error(ExitCode::config,
                "radar.address: the radar of a bridge cannot be calibrated; --set radar.address= "
                "calibrates the detector alone");
  if (options.check && config.calibration.entries.empty())
    throw Error(ExitCode::config, "--check: run.calibration names no calibration to compare with");
  const Calibration stored =
      options.check ? config.calibration : stored_in(config.calibration_path);
  if (!options.json)
    std::printf(
        "reflector taken to be %.3f m from each sensor, its echo sought from %.3f to %.3f m\n",
        options.search.distance_m, options.search.distance_m - options.search.window_m / 2,
        options.search.distance_m + options.search.window_m / 2);
  std::fflush(stdout);
  Measurement measurement(config, options, loop);
  measurement.run();
  const auto results = measurement.results();
  nlohmann::ordered_json json{{"distance_m", options.search.distance_m},
                              {"repeats", options.repeats}};
  bool refused = false;
  for (const CalibrationResult& r : results) {
    json["sensors"].push_back(json_of(r, options.search));
    if (!options.json) say(r, options.search);
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
  if (!options.json) say(response, unstated);
  Calibration fresh =
      to_calibration(results, antennas, response, options, measurement.firmware(), loop);
  fresh.axes = axes_of(config, fresh);
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
  if (options.json)
    std::printf("%s\n", json.dump(-1, ' ', true, decltype(json)::error_handler_t::replace).c_str());
  return refused ? ExitCode::device : well ? ExitCode::ok : ExitCode::failed;
}

}  // namespace echofuse::acquire
