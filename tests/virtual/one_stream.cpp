// SPDX-License-Identifier: MIT
// Sends one stream of bytes to run, import, doctor and calibrate, which must find the same faults
// and counts.
#include <nlohmann/json.hpp>

#include "acquire/calibrate/calibrate.hpp"
#include "acquire/doctor/doctor.hpp"
#include "acquire/import/import.hpp"
#include "bench.hpp"

using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

constexpr std::int64_t pulse_ps = 10'000'000, pulses_per_block = 5000;
constexpr double true_m = 1.5;

struct StreamFault {
  const char* name;
  const char* warning;  // part of the warning of each command; empty: none
  bool swaps = false, histograms = false;
  unsigned bits = 63;               // width of the tagger's counter
  std::uint32_t lost = 0, bad = 0;  // every nth block is not sent, or damaged; 0: none
};

// Time tagger behind a bridge. It sends a block every 50 ms: starts at 100 kHz, and a click
// after every 40th start.
class Tagger {
 public:
  Tagger(port::Loop& loop, const StreamFault& fault)
      : fault_(fault),
        bridge_(loop,
                std::string(R"({"model":"T","serial":"T1","firmware":"1")") +
                    (fault.histograms ? R"(,"sends":"histograms"})" : "}"),
                [this](BridgedDevice&) { next(); }) {}
  BridgedDevice& bridge() { return bridge_; }

 private:
  void next() {
    if (is_nth(fault_.lost)) bridge_.lose_block(), ++block_;
    const Bytes payload = fault_.histograms ? histogram() : tags();
    bridge_.send(fault_.histograms ? sim::BlockKind::histogram : sim::BlockKind::tags, payload,
                 is_nth(fault_.bad));
  }
  Bytes tags() {
    std::normal_distribution<double> jitter(true_m * ps_per_m, 100);
    Bytes out;
    const std::int64_t first = block_++ * pulses_per_block;
    const auto put = [&](std::int32_t channel, std::int64_t ps) {
      sim::put_tag(out, channel, ps & ((std::int64_t{1} << fault_.bits) - 1));
    };
    for (std::int64_t k = first; k < first + pulses_per_block; ++k) {
      const std::int64_t click = k * pulse_ps + std::llround(jitter(rng_));
      const bool clicks = k % 40 == 0;
      if (clicks && fault_.swaps) put(2, click);
      put(1, k * pulse_ps);
      if (clicks && !fault_.swaps) put(2, click);
    }
    return out;
  }
  Bytes histogram() {
    std::vector<std::uint32_t> counts(336, 1);
    counts[100] = 125;
    return sim::histogram_payload(counts, 336, 50'000 * static_cast<std::uint64_t>(block_++),
                                  pulses_per_block, 0, 100, 50'000);
  }
  // Returns true if the next block is an nth one; n = 0: no block.
  bool is_nth(std::uint32_t n) const { return n > 0 && bridge_.number() % n == n - 1; }

  StreamFault fault_;
  std::mt19937_64 rng_{make_rng(7, 1)};
  std::int64_t block_ = 0;
  BridgedDevice bridge_;
};

}  // namespace

TEST_CASE("run, import, doctor and calibrate find the same faults and counts in one stream") {
  const auto fault = GENERATE(StreamFault{"in order", ""},
                              StreamFault{"out of order", "events out of order", true},
                              StreamFault{"wrapping", "wrap-arounds", false, false, 40},
                              StreamFault{"losses", "", false, false, 63, 7},
                              StreamFault{"bad blocks", "", false, false, 63, 0, 9},
                              StreamFault{"histograms", "", false, true});
  CAPTURE(fault.name);
  Bench b({.window_s = 2});
  Tagger tagger(b.lab->loop, fault);
  tagger.bridge().attach(
      b, "tdc.address",
      {"depth.address=", "tdc.first_bin_ps=0", "tdc.bin_width_ps=100", "tdc.bins=336",
       "run.folder=" + b.folder / "", "run.calibration=" + b.folder / "c.toml"});

  acquire::RunOptions options = b.run(3);
  options.keep_raw = b.folder / "raw";
  REQUIRE(b.lab->record(options) == ExitCode::ok);
  const auto records = b.records();
  const auto check_warning = [&](const Strings& texts) {
    CAPTURE(texts);
    CHECK((std::string(fault.warning).empty() ||
           std::ranges::any_of(texts, [&](auto& t) { return t.find(fault.warning) != t.npos; })));
  };
  check_warning(b.events("spd"));
  const record::FusedRecord& found = records.at(1);
  const double starts_hz = static_cast<double>(found.spd_counts.starts) / 2,
               clicks_hz = static_cast<double>(found.spd_counts.in_range) / 2;
  REQUIRE(found.has(Sensor::spd));
  CHECK((found.sync[Sensor::spd].lost > 0) == (fault.lost + fault.bad > 0));
  const auto peak = std::ranges::max_element(counts(found)) - counts(found).begin();
  if (!fault.histograms)
    CHECK((static_cast<double>(peak) + 0.5) * 100 / ps_per_m == Approx(true_m).margin(0.03));

  acquire::import_kept(acquire::kept_config(options.keep_raw, {}), options.keep_raw,
                       b.folder / "imported.sqlite");
  const record::RunReader imported(b.folder / "imported.sqlite");
  // In virtual time, the raw capture ends before the closing of the last slot is written to it.
  REQUIRE(imported.count() == 2);
  for (std::int64_t k = 0; k < imported.count(); ++k) {
    const record::FusedRecord again = imported.read(k);
    const record::FusedRecord& first = records[static_cast<std::size_t>(k)];
    CHECK(difference(again, first).empty());
    CHECK(again.spd_counts.tags == first.spd_counts.tags);
    CHECK(again.sync[Sensor::spd].lost == first.sync[Sensor::spd].lost);
    CHECK(again.sync[Sensor::spd].verdict == first.sync[Sensor::spd].verdict);
  }
  Strings repeated, findings;
  for (const auto& event : imported.events()) repeated.push_back(event.text);
  check_warning(repeated);

  const std::string said = printed_by(b.folder / "said", [&] {
    acquire::DoctorOptions doctor;
    doctor.json = true;
    acquire::examine(b.lab->config(), doctor, b.lab->loop);
  });
  const nlohmann::json report = nlohmann::json::parse(said);
  for (const auto& check : report["checks"]) {
    if (check["check"] != "spd") continue;
    findings.push_back(check["found"]);
    if (!check["facts"].contains("starts_per_s")) continue;
    // A slot of doctor contains up to two blocks of 40 more or less than a slot of the run.
    CHECK(check["facts"]["starts_per_s"].get<double>() == Approx(starts_hz).epsilon(0.2));
    CHECK(check["facts"]["clicks_per_s"].get<double>() == Approx(clicks_hz).epsilon(0.2));
    CHECK(check["facts"]["share_in_range"] == 1);
    CHECK((check["facts"]["lost_tags"] > 0) == (fault.lost + fault.bad > 0));
  }
  check_warning(findings);

  acquire::CalibrateOptions calibration;
  calibration.search = {.distance_m = true_m, .window_m = 0.3};
  calibration.repeats = 6, calibration.time_s = 0.5;
  calibration.json = true;
  ExitCode code{};
  const std::string measured = printed_by(b.folder / "said", [&] {
    code = acquire::calibrate(b.lab->config(), calibration, b.lab->loop);
  });
  CAPTURE(measured);
  CHECK(code == (fault.histograms ? ExitCode::device : ExitCode::ok));
  const nlohmann::json spd = nlohmann::json::parse(measured)["sensors"][0];
  if (fault.histograms)
    CHECK_THAT(spd["refusal"].get<std::string>(), Catch::Contains("sends histograms"));
  else
    CHECK(std::abs(spd["offset_m"].get<double>()) < 1e-3);
}
