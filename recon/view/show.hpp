// SPDX-License-Identifier: MIT
// The messages that tell of a run (message.hpp), made when somebody asks.
#pragma once
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "drivers/core/clock.hpp"
#include "recon/view/followed_run.hpp"
#include "recon/view/live_model.hpp"
#include "recon/view/message.hpp"

namespace echofuse::view {

// Threading: one thread. The messages of a record throw Error if it cannot be read.
class Show {
 public:
  // `model` may be null; both outlive this. `planned`: records that the run shall have.
  Show(FollowedRun& run, const LiveModel* model, std::optional<std::int64_t> planned,
       const Clock& clock)
      : run_(run), model_(model), planned_(planned), clock_(clock) {}

  FollowedRun& run() { return run_; }
  Message about_run(bool may_write) const;
  Message state();
  Message record(std::int64_t index, bool live);  // the last one is kept
  Message strip() const;
  Message sheet(std::int64_t first, std::int64_t last) const;
  // Null until the first minute is over, or the run is.
  Message reference();

 private:
  nlohmann::json sensors() const;
  nlohmann::json disk() const;
  nlohmann::json facts() const;
  Message make_record(std::int64_t index, bool live) const;
  void judge_maps();
  FollowedRun& run_;
  const LiveModel* model_;
  std::optional<std::int64_t> planned_;
  const Clock& clock_;
  Message last_, reference_;
  std::int64_t last_index_ = -1;
  int last_edition_ = -1, reference_edition_ = -1;
  bool last_live_ = false;
  // Doubt about the newest records' maps as a whole.
  std::string doubt_;
  HostTime judged_{};
  std::int64_t judged_last_ = -1;
};

Message answer(bool ok, const std::string& text);
Message trouble(const std::string& text);

}  // namespace echofuse::view
