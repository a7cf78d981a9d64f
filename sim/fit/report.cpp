// SPDX-License-Identifier: MIT
#include <cmath>
#include <cstdio>

#include "sim/fit/fit.hpp"
#include "sim/fit/quantities.hpp"

namespace echofuse::sim {
namespace {

std::string formatted(const char* format, double a, double b) {
  char out[96];
  std::snprintf(out, sizeof out, format, a, b);
  return out;
}

// The error of a logarithm as one of the value.
std::string with_error(const Estimate& e) {
  const double error = e.logarithmic ? e.value * e.standard_error : e.standard_error;
  return formatted("%.4g +- %.2g", e.value, error);
}

std::string share_known(const Estimate& e) {
  return e.before > 0 ? formatted("%.2g of %.2g", e.standard_error, e.before) : "";
}

std::string padded(std::string text, std::size_t width) {
  if (text.size() < width) text.append(width - text.size(), ' ');
  return text;
}

}  // namespace

std::string report_of(const Fit& fit) {
  std::string out =
      formatted("%.0f records of one person, %.0f of nobody\n", static_cast<double>(fit.used),
                static_cast<double>(fit.empty.records));
  double room = 0;
  for (const double n : fit.empty.spd) room += n;
  out += formatted("signal: %.4g counts a record", fit.signal_counts, 0);
  if (fit.empty.records > 0) out += formatted("; the empty room: %.4g counts", room, 0);
  out += fit.empty.records > 0 ? "\n" : "; the empty room cannot be told: no record of nobody\n";
  for (const bool told : {true, false})
    for (const Estimate& e : fit.estimates) {
      if (e.told != told) continue;
      out += padded(e.name, 24);
      const std::string meaning = meaning_of(e.name);
      if (told)
        out += padded(with_error(e), 26) + meaning;
      else if (e.name == "radar_cloth")
        out += "cannot be told: " + e.reason;
      else
        out += "cannot be told: " + e.reason + " (error " + share_known(e) + " before)";
      while (out.back() == ' ') out.pop_back();
      out += "\n";
    }
  if (!fit.unlike.empty()) {
    out += "beyond what the default twin's laboratories show:";
    for (const auto& name : fit.unlike) out += " " + name;
    out += "\n";
  }
  return out;
}

std::string twin_of(const Fit& fit, const std::string& run) {
  const Twin prior = twin_named("default");
  const Twin narrow = narrowed(prior, fit.estimates, 2);
  std::string told = "# Fitted to " + run + ": estimate +- 2 standard errors\n";
  std::string rest = "# Cannot be told: the default range\n";
  for (const Range& range : narrow.ranges) {
    Twin one;
    one.ranges = {range};
    const std::string text = to_text(one);
    std::string& to = [&]() -> std::string& {
      for (const Estimate& e : fit.estimates)
        if (e.name == range.key && e.told) return told;
      return rest;
    }();
    to += text.substr(text.find('\n') + 1);
  }
  return told + "\n" + rest;
}

}  // namespace echofuse::sim
