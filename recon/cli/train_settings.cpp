// SPDX-License-Identifier: MIT
#include "recon/cli/train_settings.hpp"

#include <algorithm>
#include <charconv>

#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

// "512,256" becomes 512, 256.
std::vector<std::size_t> widths_of(const std::string& text) {
  constexpr std::size_t most = 65'536;
  std::vector<std::size_t> out;
  for (const std::string& part : split_at_commas(text)) {
    std::size_t value{};
    const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), value);
    if (error != std::errc{} || end != part.data() + part.size() || value < 1 || value > most)
      throw Error(ExitCode::usage,
                  "hidden: \"" + part + "\": expected widths from 1 to 65536, as 512,256");
    out.push_back(value);
  }
  return out;
}

}  // namespace

void bind(Settings& settings, TrainSettings& s) {
  TrainOptions& o = s.options;
  settings.add("scaling", o.scaling, "of each sensor's values in a record", scaling_names);
  settings.add("hidden", s.hidden, "mlp: widths of the hidden layers, as 512,256; \"\": its own");
  settings.add("basis", s.basis, 0, 1024,
               "factorised: body shapes; pca-mlp: components of the map; nearest: records; 0: 16, "
               "128, 1");
  settings.add("batch", s.batch, 0, 65'536,
               "records a step; 0: 64, of mlp and pca-mlp 128 from 3000 records on");
  settings.add("learning_rate", s.learning_rate, 0, 10,
               "at the beginning; 0: .002 (mlp; times the root of batch / 64), .003 (factorised)");
  settings.add("patience", s.patience, 0, 100'000,
               "epochs without progress before stopping; 0: 15 (mlp), 100 (factorised)");
  settings.add("test_share", o.split.test_share, 0, 0.95, "of the records, held out for evaluate");
  settings.add("validation_share", o.split.validation_share, 0, 0.95,
               "of the rest, to stop early and to choose");
  settings.add("gap", s.gap, 0, 1'000'000, "split blocked: records dropped between two parts");
  settings.add("radar_bin_m", s.radar_bin_m, 0, 3.5,
               "m, bins from 0 to 7 m that the radar's power is added up in, without its antennas "
               "(the paper: 0.5); 0: as it is");
  settings.add("fallback", o.fallback,
               "beside a model of both sensors train those for records without antennas or radar");
  settings.add("any_response", o.any_response,
               "the runs that state no response of the radar have various ones, as a twin's have: "
               "much narrower runs are taken as they are");
  settings.add(
      "doubtful", o.doubtful,
      "records with a sensor that the run says is weak, saturated or stands still, or with a "
      "doubtful camera: leave them out, or take them",
      {"leave", "take"});
  settings.add("candidates", s.candidates,
               "of the model auto, as mean,ridge; \"\": the usual ones");
}

std::string train_settings_help() {
  TrainOptions options;
  options.fallback = true;
  TrainSettings s(options);
  Settings settings;
  bind(settings, s);
  return settings.resolved(true);
}

void take(const std::vector<std::string>& assignments, TrainSettings& s) {
  Settings settings;
  bind(settings, s);
  for (const std::string& text : assignments)
    text.find('=') == std::string::npos ? settings.read_file(text) : settings.set(text);
  s.test_share_given = settings.given("test_share");
  TrainOptions& o = s.options;
  const auto wanted = [](std::int64_t value) {
    return value > 0 ? std::optional(static_cast<std::size_t>(value)) : std::nullopt;
  };
  if (!s.hidden.empty()) o.fit.hidden = widths_of(s.hidden);
  o.fit.basis = wanted(s.basis), o.fit.batch = wanted(s.batch), o.fit.patience = wanted(s.patience);
  if (s.learning_rate > 0) o.fit.learning_rate = s.learning_rate;
  o.split.gap = static_cast<int>(s.gap);
  o.candidates = split_at_commas(s.candidates);
  for (const std::string& name : o.candidates) candidate_of(name, {});
}

}  // namespace echofuse::recon
