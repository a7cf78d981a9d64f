// SPDX-License-Identifier: MIT
// From one world to another: models trained in world A, with few records of world B. A is the
// simulator's base condition, or virtual laboratories of the twin; B is one that A never drew. B
// chooses nothing: what tuning chooses it chooses among the few records that it is given.
#pragma once
#include <array>
#include <string>
#include <vector>

#include "recon/estimator/tune.hpp"
#include "recon/study/study_file.hpp"

namespace echofuse::recon {

struct TransferOptions : StudyOptions {  // each seed has its own records, and its own world B
  std::string sim;                       // the simulator (simulate.hpp)
  std::string twin = "default";          // of `echofuse-sim dataset`
  std::string model = "factorised";
  bool quick = false;
  std::vector<std::size_t> sizes;             // of B's records; none: those of the study
  std::size_t records = 0, test_records = 0;  // of A; of B to judge by; 0: those of the study
};
TransferOptions complete(TransferOptions options);

// Worlds A draw laboratories 0 to N - 1; B of seed s is laboratory first_b + s.
inline constexpr std::size_t laboratories_of_a = 200, first_b = 1000;

inline constexpr std::array transfer_metrics = {metric_iou, metric_lateral_m, metric_ssim_hard};

// Axis: "base" or "twin", where the model comes from, or "none"; value: records of B; model: what
// was done. Further metrics where a model states its uncertainty: "within_90" (share of B's records
// within their intervals); and "train_s".
// Measures what OUT/study.sqlite does not have yet: all that it has then; of a part: nothing.
// Throws Error(config) if what is there was measured otherwise, and as StudyFile and Simulator.
std::vector<Measurement> study_transfer(const TransferOptions& options);

struct TransferRow {
  std::string from, model;
  std::size_t records = 0, seeds = 0;
  std::array<double, transfer_metrics.size()> mean{}, spread{};  // spread: NaN of one seed
  double within_90 = 0;                                          // mean; NaN if not stated
  double train_s = 0;        // mean of what was timed; NaN if nothing was, as by parts
  std::string machine = {};  // which timed it; "a+b" of several
};
std::vector<TransferRow> summarise_transfer(const std::vector<Measurement>& all);
std::string to_text(const std::vector<TransferRow>& rows);
// transfer.csv and transfer.svg. Throws Error(disk); the table is written first.
void write_transfer(const std::vector<TransferRow>& rows, const std::string& folder);

}  // namespace echofuse::recon
