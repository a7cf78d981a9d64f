// SPDX-License-Identifier: MIT
// Creates the messages that describe a run (message.hpp) when they are needed.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "acquire/measurement/response.hpp"
#include "acquire/record/alerts.hpp"
#include "drivers/core/clock.hpp"
#include "recon/live/followed_run.hpp"
#include "recon/live/live_model.hpp"
#include "recon/live/message.hpp"

namespace echofuse::view {

// Threading: must be used from one thread only. Functions that read a record throw Error if the
// record cannot be read.
class RunMessages {
 public:
  // `model` may be null. `run`, `model` and `clock` must outlive this object. `planned`: number of
  // records planned for the run.
  RunMessages(FollowedRun& run, const LiveModel* model, std::optional<std::int64_t> planned,
              const Clock& clock)
      : run_(run), model_(model), planned_(planned), clock_(clock) {}

  FollowedRun& run() { return run_; }
  const FollowedRun& run() const { return run_; }
  UtcTime now() const { return clock_.utc(); }
  Message about_run(bool may_write);
  Message state();
  // Returns the message for one record; caches the most recent message.
  Message record(std::int64_t index, bool live);
  // Returns the message for the sum of several records; `index` is the index of the last of these
  // records.
  Message sum(std::int64_t index, const ShowSum& request);
  Message strip() const;
  Message sheet(std::int64_t first, std::int64_t last) const;
  // Returns the message with the mean histogram of the first minute; null until one minute has
  // passed or the run has ended.
  Message reference();
  // Returns the indices of the records with the lowest and the median IoU among records at equal
  // distances. Omits records on which the model was trained. Empty without a model.
  std::vector<std::int64_t> worst_and_median() const;

 private:
  struct RunSettings {  // settings read from the configuration stored in the run
    double laser_hz = 0, max_clicks_per_pulse = record::max_clicks_per_pulse;
    record::AlertLimits alert;
  };
  const RunSettings& settings();
  nlohmann::json sensors() const;
  nlohmann::json worst(Sensor sensor) const;
  nlohmann::json disk() const;
  nlohmann::json alerts();
  nlohmann::json facts() const;
  // Returns the trigger levels contained in the time tagger's firmware string; empty if there are
  // none.
  std::string trigger_levels() const;
  Message make_record(std::int64_t index, bool live);
  void add_maps(MessageWriter& out, nlohmann::json& head, const record::FusedRecord& record,
                const record::RunReader& run);
  std::optional<std::int64_t> first_since_mark(std::int64_t index) const;
  void check_maps();
  std::vector<float> track(const record::RunReader& run, std::int64_t index);
  FollowedRun& run_;
  const LiveModel* model_;
  std::optional<std::int64_t> planned_;
  const Clock& clock_;
  PerSensor<record::LastingState> states_;  // for alerts()
  Message last_, reference_;
  std::int64_t last_index_ = -1;
  struct Summed {
    Tally tally;
    std::int64_t first = 0, last = -1;
    int edition = -1;
  };
  std::map<std::int64_t, Summed> sums_;  // cached sums, by requested number of records
  struct TrackPoint {  // body position and half-width of its 90 % interval, m; NaN if unknown
    float x_m, z_m, interval_90_m;
  };
  static TrackPoint place_of(const Reconstruction& made);
  std::map<std::int64_t, TrackPoint> places_;  // cached points of the track, by record index
  RunSettings settings_;
  int last_edition_ = -1, places_edition_ = -1, reference_edition_ = -1, settings_edition_ = -1;
  bool last_live_ = false;
  GroupCheck group_;  // result for the newest records
  HostTime checked_{};
  std::int64_t checked_last_ = -1;
};

// Returns at most `count` of the values, at equal distances, with the first and the last one.
std::vector<std::int64_t> spread(const std::vector<std::int64_t>& values, std::size_t count);

// Calls visit(key, value) for each setting in a resolved configuration, e.g. with "tdc.bins" and
// "336".
void for_each_setting(const std::string& resolved,
                      const std::function<void(const std::string&, const std::string&)>& visit);

Message answer(bool ok, const std::string& text);
Message trouble(const std::string& text);

}  // namespace echofuse::view
