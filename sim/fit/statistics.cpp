// SPDX-License-Identifier: MIT
#include "sim/fit/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "acquire/record/letter.hpp"
#include "drivers/core/exit_code.hpp"
#include "sim/fit/sensor_fit.hpp"

namespace echofuse::sim {
namespace {

using record::FusedRecord;
using Values = std::vector<double>;

constexpr std::size_t fewest = 10;

double median(Values v) {
  if (v.empty()) return 0;
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

// 1.48 times the median distance from the median: a Gaussian's standard deviation.
double spread(const Values& v) {
  const double m = median(v);
  Values away;
  for (const double x : v) away.push_back(std::abs(x - m));
  return 1.4826 * median(away);
}

// Least squares of y on 1, x and x^2, twice: the second time without what is off by 3 spreads.
struct Parabola {
  double at_0 = 0, slope = 0, bend = 0;
};
Parabola parabola(const Values& x, const Values& y) {
  Parabola p;
  std::vector<bool> kept(x.size(), true);
  for (int round = 0; round < 2; ++round) {
    Eigen::Matrix3d a = Eigen::Matrix3d::Identity() * 1e-9;
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (!kept[i]) continue;
      const Eigen::Vector3d row(1, x[i], x[i] * x[i]);
      a += row * row.transpose();
      b += row * y[i];
    }
    const Eigen::Vector3d found = a.ldlt().solve(b);
    p = {found[0], found[1], found[2]};
    Values rest;
    for (std::size_t i = 0; i < x.size(); ++i)
      rest.push_back(y[i] - p.at_0 - p.slope * x[i] - p.bend * x[i] * x[i]);
    const double most = 3 * std::max(1e-9, spread(rest));
    for (std::size_t i = 0; i < x.size(); ++i) kept[i] = std::abs(rest[i]) < most;
  }
  return p;
}

double log_of(double v) { return std::log(std::max(v, 1e-12)); }

bool has_letter(const FusedRecord& r) { return record::letter_of(r.label).has_value(); }
bool nobody(const FusedRecord& r) { return r.label == "empty"; }
bool one_person(const FusedRecord& r) {
  return !nobody(r) && r.label != "two_people" && r.label != "reflector" &&
         r.label.rfind("object:", 0) != 0;
}
bool complete(const FusedRecord& r) {
  return r.has(Sensor::spd) && r.has(Sensor::radar) && r.has(Sensor::depth);
}

class Summary {
 public:
  Summary(const EmptyRoom& empty, const Conditions& c) : empty_(empty), c_(c), response_(c) {}

  void add(const FusedRecord& r) {
    const bool letter = has_letter(r);
    const Surface s = surface_of(r.depth_mm, empty_.depth_mm, map_grid(c_), letter);
    if (s.patches.size() < 16 * 30) return;  // fewer than 30 pixels
    ++used_;
    Values counts(r.spd.begin(), r.spd.end()), power(r.radar.begin(), r.radar.end());
    // Before anybody: background. It counts at the room, too.
    const double dark = background(counts, s);
    v_["background"].push_back(dark * static_cast<double>(c_.bins));
    for (std::size_t i = 0; i < counts.size(); ++i)
      counts[i] -= empty_.open() ? dark : empty_.spd[i];
    // The transmitter's own echo stays.
    const auto from = static_cast<std::size_t>(
        std::max(0.0, 1.5 * c_.radar_resolution_m - c_.radar_start_m) / c_.radar_step_m);
    for (std::size_t i = from; i < power.size() && !empty_.open(); ++i) power[i] -= empty_.radar[i];
    cut(counts, s);
    look(s, letter);
    const LightFit light = fit_light(s, counts, c_);
    const EchoFit echo = fit_echo(s, power, c_);
    response_.add(light.rendered, counts);
    double signal = 0;
    for (const double n : counts) signal += n;
    v_["signal_counts"].push_back(signal);
    gain_[letter].push_back(log_of(signal / light.expected));
    echo_[letter].push_back(log_of(echo.peak / echo.expected));
    tangent_[letter].push_back(s.tangent());
    if (light.torso > 0 && light.legs > 0)
      v_["legs_light"].push_back(log_of(light.legs / light.torso));
    if (light.torso > 0 && light.head > 0)
      v_["head_light"].push_back(log_of(light.head / light.torso));
    body_light_.push_back(log_of(std::max(light.torso, 1e-3 * light.legs)));
    body_echo_.push_back(log_of(echo.body));
    sine_.push_back(echo.sine);
    shift_.push_back(echo.shift_m);
    v_["radar_width"].push_back(echo.width);
    const double of_mean = empty_.open() ? 0 : 1 / static_cast<double>(empty_.records);
    v_["radar_noise"].push_back(echo.noise / echo.peak / std::sqrt(1 + of_mean));
    v_["radar_leakage"].push_back(echo.leakage / echo.peak);
    v_["radar_behind"].push_back(echo.behind / echo.peak);
    if (!letter) return;
    if (light.plate > 0 && light.torso > 0)
      v_["plate_light"].push_back(log_of(light.plate / light.torso));
    if (echo.plate <= 0 || echo.body <= 0) return;
    v_["plate_echo"].push_back(log_of(echo.plate / echo.body));
  }

  Statistics result() const {
    if (used_ < fewest)
      throw Error(ExitCode::failed, "fit: " + std::to_string(used_) +
                                        " records with one person and all sensors; at least " +
                                        std::to_string(fewest) + " are needed");
    Statistics out;
    const auto put = [&](const std::string& name, double value) {
      out.emplace_back(name, std::isfinite(value) ? value : 0);
    };
    for (const auto& [name, values] : v_) {
      put(name, location(name, values));
      if (name != "signal_counts" && name != "background") put(name + "_spread", spread(values));
    }
    const ResponseFit::Response r = response_.solve();
    put("response_delay_ps", r.delay_ps);
    put("response_width", log_of(r.sigma_ps));
    put("response_tail", r.tail_share);
    const Parabola shift = parabola(sine_, shift_);
    put("shift_m", shift.at_0);
    put("shift_slope", shift.slope);
    put("shift_bend", shift.bend);
    const Parabola light = parabola(places(), levelled(gain_)),
                   echo = parabola(places(), levelled(echo_));
    put("light_level", median(gain_[0].empty() ? gain_[1] : gain_[0]));
    put("light_slope", light.slope);
    put("light_bend", light.bend);
    put("echo_slope", echo.slope);
    put("echo_bend", echo.bend);
    put("light_spread", spread(body_light_));
    put("echo_spread", spread(body_echo_));
    put("echo_follows", parabola(centred(body_light_), body_echo_).slope);
    return out;
  }

 private:
  // Counts per bin before the nearest patch, by half a metre and the response.
  double background(const Values& counts, const Surface& s) const {
    double nearest = 1e9;
    for (const SurfacePatch& p : s.patches) nearest = std::min(nearest, p.z);
    const double to = (ps_per_m * (nearest - 0.3) - c_.first_bin_ps) / c_.bin_width_ps;
    const auto n =
        static_cast<std::size_t>(std::clamp(to, 0.0, static_cast<double>(counts.size())));
    double sum = 0;
    for (std::size_t i = 0; i < n; ++i) sum += counts[i];
    return n > 0 ? sum / static_cast<double>(n) : 0;
  }
  // What is far behind is the room and its shadow.
  void cut(Values& counts, const Surface& s) const {
    double farthest = 0;
    for (const SurfacePatch& p : s.patches)
      farthest = std::max(farthest, std::sqrt(p.x * p.x + p.y * p.y + p.z * p.z));
    const double from = (ps_per_m * (farthest + 0.5) - c_.first_bin_ps) / c_.bin_width_ps;
    for (std::size_t i = static_cast<std::size_t>(std::max(0.0, from)); i < counts.size(); ++i)
      counts[i] = 0;
  }
  void look(const Surface& s, bool letter) {
    const std::string kind = letter ? "letter_" : "person_";
    v_[kind + "top_m"].push_back(s.top);
    v_[kind + "area"].push_back(log_of(s.area));
    v_[kind + "width"].push_back(log_of(s.width));
    v_["foot_m"].push_back(s.foot);
    v_["roughness"].push_back(s.roughness);
    v_["holes"].push_back(s.holes);
    if (!letter) return;
    v_["plate_area"].push_back(log_of(s.plate_area));
    v_["plate_gap_m"].push_back(s.plate_gap);
    v_["plate_drop_m"].push_back(s.plate_drop);
  }
  // Small numbers of counts: their mean tells more than their median.
  static double location(const std::string& name, const Values& v) {
    if (name != "background" && name != "holes" && name != "roughness") return median(v);
    double sum = 0;
    for (const double x : v) sum += x;
    return sum / static_cast<double>(v.size());
  }
  static Values centred(Values v) {
    const double m = median(v);
    for (double& x : v) x -= m;
    return v;
  }
  // People and letters each about their own median.
  static Values levelled(const Values (&of)[2]) {
    Values all = centred(of[0]);
    const Values letters = centred(of[1]);
    all.insert(all.end(), letters.begin(), letters.end());
    return all;
  }
  Values places() const {
    Values all = tangent_[0];
    all.insert(all.end(), tangent_[1].begin(), tangent_[1].end());
    return all;
  }

  const EmptyRoom& empty_;
  const Conditions& c_;
  std::size_t used_ = 0;
  std::map<std::string, Values> v_;
  Values gain_[2], echo_[2], tangent_[2], body_light_, body_echo_, sine_, shift_;
  ResponseFit response_;
};

}  // namespace

bool EmptyRoom::open() const {
  return std::all_of(depth_mm.begin(), depth_mm.end(), [](auto mm) { return mm == 0; });
}

EmptyRoom empty_room(const std::vector<FusedRecord>& records) {
  EmptyRoom room;
  std::vector<const FusedRecord*> empty;
  for (const FusedRecord& r : records)
    if (nobody(r) && complete(r)) empty.push_back(&r);
  room.records = static_cast<std::int64_t>(empty.size());
  if (empty.empty()) return room;
  const auto n = static_cast<double>(empty.size());
  room.spd.resize(empty[0]->spd.size());
  room.radar.resize(empty[0]->radar.size());
  room.depth_mm.resize(empty[0]->depth_mm.size());
  for (const FusedRecord* r : empty) {
    for (std::size_t i = 0; i < room.spd.size(); ++i) room.spd[i] += r->spd[i] / n;
    for (std::size_t i = 0; i < room.radar.size(); ++i) room.radar[i] += r->radar[i] / n;
  }
  for (std::size_t i = 0; i < room.depth_mm.size(); ++i) {
    Values z;
    for (const FusedRecord* r : empty) z.push_back(r->depth_mm[i]);
    room.depth_mm[i] = static_cast<std::uint16_t>(median(z));
  }
  return room;
}

bool shows_one_person(const FusedRecord& r) { return one_person(r) && complete(r); }

Statistics statistics_of(const std::vector<FusedRecord>& records, const EmptyRoom& empty,
                         const Conditions& nominal) {
  Summary summary(empty, nominal);
  for (const FusedRecord& r : records)
    if (shows_one_person(r)) summary.add(r);
  return summary.result();
}

}  // namespace echofuse::sim
