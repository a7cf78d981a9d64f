// SPDX-License-Identifier: MIT
// What else a run says when the radar sees its bodies at other ranges than in training: a range
// bias, people to one side and other reflectivities all move a body's echo. A range bias moves
// what stands still as well: a wall, a corner reflector, the transmitter's leakage at range 0. And
// where gains are stable, people to one side change the brightness by what they move the echo
// (brightness.hpp), a range bias does not, and a gain changes it alone.
#pragma once
#include <string>
#include <vector>

#include "acquire/record/h5.hpp"
#include "recon/data/dataset.hpp"
#include "recon/uncertainty/gains.hpp"

namespace echofuse::recon {

// How far what stands still has moved; not seen if nothing does, or if noise hides 5 cm.
struct EchoMove {
  bool seen = false;
  double moved_m = 0, standard_error_m = 0;  // to longer ranges
  std::size_t records = 0;                   // that tell
  std::size_t empty_records = 0;             // of them, which then are all; 0: nobody was away
};

// The echoes of the training records that stand still.
class StaticEchoes {
 public:
  StaticEchoes() = default;
  StaticEchoes(const Dataset& data, const Rows& rows);
  bool known() const;  // any echo stands still
  // Of a run on the model's axes, whose rows with nobody are known (Alignment). `longer`: whether a
  // range bias would be to longer ranges; what would come to lie before range 0 says nothing of
  // shorter ones. Standard errors by resampling blocks of records.
  EchoMove judge(const Dataset& data, const Matrix& aligned, bool longer) const;

  void save(record::H5File& file) const;  // below "range_bias/"
  void load(const record::H5File& file);

 private:
  double move_of(const std::vector<float>& profile, const Rows& bins, double step_m) const;
  std::vector<float> power_, steady_;  // of each bin the median; 1 where it hardly varies
};

struct RangeBiasEvidence {
  enum class Says : std::uint8_t { nothing, range_bias, no_range_bias };
  Says says = Says::nothing;
  std::string text;  // for the user; may be there although it decides nothing
};

// Of a run whose bodies have moved by so much, +- its standard error, at a mean range.
struct MovedBodies {
  double moved_m, standard_error_m, range_m;
};
RangeBiasEvidence weigh(const MovedBodies& bodies, const EchoMove& echoes, const GainCheck& gains);

// When the radar of these runs was calibrated, as "; calibrated 3 days before the run"; empty if
// that is not known.
std::string calibration_age(const Dataset& data);

}  // namespace echofuse::recon
