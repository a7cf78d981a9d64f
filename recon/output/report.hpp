// SPDX-License-Identifier: MIT
// The three modes side by side: one self-contained HTML page, and its pictures as PNG files.
#pragma once
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "recon/estimator/evaluate.hpp"

namespace echofuse::recon {

struct ReportOptions {
  std::string dir;
  std::vector<std::string> fused, spd, radar;  // model files; several of a mode are its seeds
  std::string run;                             // its held-out records with both sensors are scored
  std::vector<std::string> paper;              // optional: fused as well, beside the first
  std::string live;                            // optional: a recorded run, for the fused model
  bool force = false;                          // also over a report of another run
};

struct ModeResult {
  std::string name;
  Inputs inputs{};
  double paper_ssim = 0;                // Lai et al., Chin. Opt. Lett. 22, 022701 (2024)
  std::vector<Evaluation> evaluations;  // one a model
  Summaries metrics;  // of a single model: as evaluated; of several: mean and SE over the models
};

struct Picture {
  std::string file, caption;
  Bytes png;
};

struct Report {
  std::string run, run_uuid;
  std::vector<ModeResult> modes;  // fused, SPD, radar
  std::vector<ScoredRow> baselines;
  std::size_t records = 0;
  std::vector<Picture> pictures;
  std::string live;  // empty: none
  Evaluation live_evaluation;
};

// Throws Error(usage) if the folder holds a report of another run, or pictures of a report's names:
// to be asked before a long evaluation.
void check_report_folder(const ReportOptions& options);
Report make_report(const ReportOptions& options);
std::string to_html(const Report& report);
// The three modes as a text table for the terminal.
std::string to_text(const Report& report);
// Writes DIR/report.html and the pictures; returns the page's path.
std::string write_report(const Report& report, const std::string& dir);

}  // namespace echofuse::recon
