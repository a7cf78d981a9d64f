// SPDX-License-Identifier: MIT
#include "recon/uncertainty/range_bias_evidence.hpp"

#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;

TEST_CASE("brightness tells people to one side from a range bias, and a gain from both") {
  using Says = RangeBiasEvidence::Says;
  // 4 cm at 4 m are 4 % less power if people stand to the right.
  const auto by = [](double change) {
    return weigh({0.04, 0.004, 4}, {}, GainCheck{100, change, 0.005, true});
  };
  CHECK(by(0.001).says == Says::range_bias);
  CHECK_THAT(by(0.001).text, Catch::Contains("people do not stand to one side"));
  CHECK(by(-0.04).says == Says::no_range_bias);
  CHECK(by(0.2).says == Says::nothing);
  CHECK_THAT(by(0.2).text, Catch::Contains("gain or bias"));
  CHECK(weigh({0.04, 0.004, 4}, {}, {}).text.empty());
  // The echoes stayed, and the brightness too.
  const EchoMove stayed{true, 0, 0.004, 0};
  const auto contradiction = weigh({0.04, 0.004, 4}, stayed, GainCheck{100, 0, 0.005, true});
  CHECK(contradiction.says == Says::nothing);
  CHECK_THAT(contradiction.text, Catch::Contains("contradict"));
}

TEST_CASE("the age of the run's calibration is said beside a range bias") {
  Dataset data = testing::load_plates(10);
  CHECK(calibration_age(data).empty());
  data.sources.front().calibrated_days = 41.2;
  CHECK(calibration_age(data) == "calibrated 41 days before the run");
}
