// SPDX-License-Identifier: MIT
// Whether the radar's ranges have slipped against the SPD's since training, from records without
// labels. Nothing but the side on which a body stands moves the radar's profile against the
// histogram (by b x / r), and bodies stand within the trained area: so the leftmost and the
// rightmost ones of a run must lie where those of the training lay. When both edges have moved by
// the same length, the ranges have slipped by it; when they have not, people stand elsewhere, and
// the slip can only be bounded. Neither the way in which people spread between the edges nor gain,
// impulse response or noise moves the estimate.
//
// Not to be seen: what moves both sensors alike, and a whole stage that was moved sideways.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/dataset.hpp"
#include "recon/models/alignment.hpp"

namespace echofuse::recon {

enum class SlipAction : std::uint8_t { warn, correct, ignore };
SlipAction slip_action_of(const std::string& name);  // throws Error(usage)
inline const std::vector<std::string> slip_action_names = {"warn", "correct", "ignore"};

struct Slip {
  enum class Verdict : std::uint8_t {
    few,      // records, for any answer
    none,     // to be seen
    unclear,  // the edges moved differently
    found
  };
  Verdict verdict = Verdict::few;
  std::size_t records = 0;                 // with a body in both sensors
  double metres = 0, error = 0;            // radar ranges longer than in training, standard error
  double left_m = 0, right_m = 0;          // displacement of either edge
  std::string text(bool corrected) const;  // for the user; empty if there is nothing to say
};

// How far behind the SPD the radar sees the bodies of the training records.
class SlipReference {
 public:
  SlipReference() = default;
  // Of both sensors' readings.
  SlipReference(const Dataset& data, const Rows& rows);

  bool known() const { return !displacements_m_.empty(); }  // false in models of earlier versions
  // Appends what the rows with two live sensors show. The data must be on the model's axes.
  void measure(const Dataset& data, std::vector<float>& displacements_m) const;
  // Standard errors by the bootstrap (Efron 1979), the same for the same records.
  Slip judge(std::vector<float> displacements_m) const;

  void save(record::H5File& file) const;
  void load(const record::H5File& file);

 private:
  void measure(const Dataset& data, const Rows& rows, std::vector<float>& out) const;
  Alignment alignment_;
  std::vector<float> displacements_m_;  // sorted
};

// Moves the radar's profiles, on the axis that the data have, to ranges shorter by this.
void shorten_radar(Dataset& data, double metres);

}  // namespace echofuse::recon
