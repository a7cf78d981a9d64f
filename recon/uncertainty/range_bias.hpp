// SPDX-License-Identifier: MIT
// Whether the radar's ranges have a bias against the SPD's since training, from records without
// labels. The radar sees a body farther than the SPD by b x / r, and by a little that depends on
// its shape, which a linear regression on the histogram takes off. What is left tells the side on
// which a body stands. The 5 % and 95 % quantiles of a run are held against those of the training:
// when both have moved by the same length, either that is a range bias, or people stand
// further to one side. Nothing in the records tells these apart, and a little bias looks like a
// long way: 1 cm like r / b = 7 cm at 3.5 m with a baseline of 0.5 m. So the user decides, by
// correcting or not. When the quantiles have moved differently, people spread differently (the
// quantiles follow that, and noise moves them outwards) or the radar stands elsewhere, and nothing
// can be told. Gains and the impulse response do not matter.
//
// Bodies that reflect the radar otherwise, as other clothes or plates do, move its centroid as
// well.
//
// The radar's antennas see the direction, so with them the regression also takes off what the side
// makes of it (its cosine and the square), and the median of what is left does not depend on where
// people stand.
//
// What else tells is asked where the bodies have moved (range_bias_evidence.hpp). In front of
// walls, whose own echoes move along, only what stands still is looked at.
//
// Limit: a shift common to both sensors is invisible. Not tried: with the radar's power in wide
// bins, where echoes have no place to 1 cm.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/models/body/alignment.hpp"
#include "recon/models/model.hpp"
#include "recon/uncertainty/range_bias_evidence.hpp"

namespace echofuse::recon {

enum class RangeBiasAction : std::uint8_t { warn, correct, ignore };
RangeBiasAction range_bias_action_of(const std::string& name);  // throws Error(usage)
inline const std::vector<std::string> range_bias_action_names = {"warn", "correct", "ignore"};

struct RangeBias {
  enum class Status : std::uint8_t {
    too_few_records,  // for any answer, or to see 3 cm
    not_detected,
    inconsistent,  // the quantiles moved differently; with antennas, ranges contradict directions
    detected       // or people stand further to one side
  };
  Status status = Status::too_few_records;
  std::size_t records = 0;                  // with a body in both sensors
  double bias_m = 0, standard_error_m = 0;  // radar ranges longer than in training
  double left_m = 0, right_m = 0;           // how far either quantile moved; without antennas
  bool by_angle = false;                    // antennas tell: people to one side are no range bias
  bool by_echoes = false;                   // of what stands still alone
  RangeBiasEvidence evidence = {};          // where bodies have moved
  // For the user; empty if there is nothing to say. `other_shapes`: the run's bodies or sensors
  // differ from the training's (DomainShift::changes_shapes), so that no range tells a bias.
  std::string text(bool corrected, bool other_shapes = false) const;
};

// How far behind the SPD the radar saw the bodies of the training records.
class RangeBiasReference {
 public:
  RangeBiasReference() = default;
  // Of both sensors; the rows in the order of their records. Row i of the aligned features is of
  // record i of the data.
  RangeBiasReference(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
                     const Rows& rows);

  // False in models of earlier versions. Of bodies: false with fewer than 50 records, and in front
  // of walls unless the training knew its empty room; of still echoes: with fewer than 20.
  bool known() const { return knows_bodies() || echoes_.known(); }
  bool knows_bodies() const { return !displacements_m_.empty(); }
  // What the rows with two live sensors show, in their order. The data must be on the model's axes.
  std::vector<float> measure(const Alignment& alignment, const Dataset& data,
                             const Matrix& aligned) const;
  // Standard errors by the bootstrap of circular blocks (Politis and Romano 1992), as a pose may be
  // held for some records in a row; the same for the same records.
  RangeBias judge(std::vector<float> displacements_m) const;
  // All that a run says, whose gains have been looked at if they ought to be stable.
  RangeBias judge(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
                  const GainCheck& gains) const;

  void forget_echoes() { echoes_ = {}; }

  void save(record::H5File& file) const;
  void load(const record::H5File& file, const Alignment& alignment);

 private:
  std::vector<float> less_expected(const Matrix& histograms, const Matrix& displacements_m) const;
  RangeBias judge_by_angle(const std::vector<float>& found) const;
  static std::size_t inputs(const Alignment& alignment);
  bool by_angle_ = false;
  std::shared_ptr<Model> expected_;     // from histogram, direction and range to displacement
  std::vector<float> displacements_m_;  // of the training records, less what is expected
  StaticEchoes echoes_;
};

// Looks for a range bias among the records that came last.
class RangeBiasWatch {
 public:
  // The range bias if one has come up with these displacements (RangeBiasReference::measure).
  std::optional<RangeBias> add(const RangeBiasReference& reference,
                               const std::vector<float>& found_m);

 private:
  std::vector<float> displacements_m_;
  std::size_t watched_ = 0;
  RangeBias::Status status_ = RangeBias::Status::too_few_records;
};

}  // namespace echofuse::recon
