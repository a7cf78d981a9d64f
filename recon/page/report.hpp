// SPDX-License-Identifier: MIT
// One self-contained HTML page for people who look before they read: models beside each other on a
// run's held-out records, two models record by record, or a run as it was recorded.
#pragma once
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/page/run_story.hpp"
#include "recon/use/evaluate.hpp"
#include "recon/use/map_pictures.hpp"
#include "recon/use/paired.hpp"

namespace echofuse::recon {

struct ReportOptions {
  std::string dir;
  // FILE or NAME=FILE; by default the name is the file's without folder and ending. The first is
  // the subject; several of a name are its seeds.
  std::vector<std::string> models;
  std::string run;                   // its held-out records with all the models' sensors are scored
  std::vector<std::string> compare;  // two model files, in place of those above
  std::string live;                  // a recorded run: its story, and its maps by the subject
  std::string empty;                 // a run of nobody in the room of these runs; may be left out
  std::string command;               // as it was typed; for the page
  bool force = false;                // also over a report of another run
  bool quiet = true;                 // no progress lines
};

// This is what the page says of a model.
struct ModelFacts {
  std::string file, name;
  std::uint64_t seed = 0, split_seed = 0;
  std::uint32_t data_hash = 0;
  std::size_t train = 0, validation = 0, test = 0;  // records of its split
  TrainingLog log;
  bool papers = false;  // the network that the paper's values are of
};

// This is where the true map of a record has its body.
struct RecordFacts {
  std::int64_t index = 0;
  std::string label;
  double range_m = 0, side_m = 0;  // NaN: nobody
};

struct ModeResult {
  std::string name;
  Inputs inputs{};
  std::string takes;  // "SPD + 8 antennas", "SPD alone"; "no sensor" of a constant map
  std::vector<Evaluation> evaluations;  // one a model
  Summaries metrics;  // of a single model: as evaluated; of several: mean and SE over the models
  std::vector<ModelFacts> models;
  std::vector<RecordFacts> records;  // of the first evaluation's rows
};

// A model's map of a shown record; the hard map, as it is scored.
struct ShownMap {
  std::string name;
  // deviation: empty if nothing is stated; share: how far each pixel has come from the room (0) to
  // a body (1), so that what the model leaves open shows.
  std::vector<float> map, deviation, share;
  MapScores scores{};
  std::string stated, warning;  // "within 8 cm sideways (90 %)"; out of distribution, in words
};
struct ShownRecord {
  std::string title, caption;
  std::vector<float> truth;
  double half_tangent = 0;
  Axis spd_axis, radar_axis;
  std::vector<float> clicks, power;  // as measured; power is no decibels
  double body_m = 0;                 // mean range of the body in the truth; NaN: nobody
  std::vector<ShownMap> maps;
};

struct Report {
  std::string run, run_uuid;
  bool simulated = false, new_run = false;                // new: no model was trained on it
  double window_s = 0;                                    // of a record; 0: not stated
  DepthSpan span;                                         // of all its maps
  std::vector<std::pair<std::string, std::string>> made;  // how: name and value
  std::string room;                                       // what was done about another room
  std::vector<ModeResult> modes;  // the subject first; those of equal inputs together
  std::optional<Judge> judge;     // of all modes
  std::vector<ScoredRow> baselines;
  std::size_t records = 0;
  std::vector<ShownRecord> main;     // person, letter: by all modes
  std::vector<ShownRecord> gallery;  // best, median, worst of the first mode
  std::vector<PairedDifference> differences;
  std::vector<MapScores> paired;   // of the compared models: gains by record
  std::optional<RunStory> story;   // of a live run
  std::optional<Evaluation> live;  // of its records by the first mode's model
};

// Throws Error(usage) if the folder holds a report of another run, or if the options do not fit
// each other: to be asked before a long evaluation.
void check_report(const ReportOptions& options);
Report make_report(const ReportOptions& options);
// The table of the first screen as text for the terminal.
std::string to_text(const Report& report);
// Writes DIR/report.html; returns its path.
std::string write_report(const Report& report, const std::string& dir);

// Parts of make_report, by what they need.
ShownRecord show_record(const std::vector<const TrainedModel*>& models,
                        const std::vector<std::string>& names, const Dataset& data, std::size_t row,
                        const Scene& judge);
// This is how a page was made: program, host, run and models.
std::vector<std::pair<std::string, std::string>> how_made(const ReportOptions& options,
                                                          const Report& report,
                                                          const Dataset* data);

}  // namespace echofuse::recon
