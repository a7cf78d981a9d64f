// SPDX-License-Identifier: MIT
// The page and the text of a report.
#include "recon/output/report_page.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"
#include "drivers/core/console.hpp"
#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

std::string of_made(const Report& report, const std::string& name) {
  for (const auto& [key, text] : report.made)
    if (key == name) return text;
  return {};
}

std::string shortened(const std::string& text, std::size_t most) {
  return text.size() <= most ? text : text.substr(0, most) + " ...";
}

// When, where and by what, in one line.
std::string origin(const Report& report) {
  std::string host = of_made(report, "host");
  host = host.substr(0, host.find(' '));
  std::string out = of_made(report, "date") + ", " + host + ", echofuse " + version() + ". Run " +
                    report.run.substr(report.run.rfind('/') + 1) +
                    (report.simulated ? " (simulated)" : "") + " of " +
                    of_made(report, "recorded").substr(0, 20) + ".";
  if (report.story && report.story->path != report.run)
    out += " Recorded run " + report.story->path.substr(report.story->path.rfind('/') + 1) + ".";
  std::istringstream words(of_made(report, "command"));
  std::string command;
  for (std::string word; words >> word;) {
    if (!command.empty()) command += ' ';
    command += word.substr(word.rfind('/') + 1);
  }
  return out + " Command: " + shortened(command, 160);
}

// The gravest of either run; the others are in their section.
std::string first_failures(const Report& report) {
  constexpr std::size_t most = 4;
  const auto problems = problems_of(report);
  if (problems.empty()) return {};
  std::string out = "<div class=\"fail\"><b>What fails</b><ul>";
  for (std::size_t i = 0; i < std::min(most, problems.size()); ++i)
    out += "<li>" + chart::escaped(problems[i].text) + "</li>";
  out += "</ul>";
  if (!report.modes.empty())
    out += "<a href=\"#failures\">" +
           (problems.size() > most ? formatted("%zu more, and", problems.size() - most)
                                   : std::string("Numbers, and")) +
           " which records</a>";
  return out + "</div>\n";
}

// What the numbers of this very table say about whole-map SSIM.
std::string ssim_note(const Report& report) {
  const Summaries& own = report.modes.front().metrics;
  const double raw = own[metric_ssim].mean, hard = own[metric_ssim_hard].mean;
  std::string scores = formatted("%.3f", raw);
  if (std::abs(raw - hard) >= 5e-4) scores += formatted(" raw and %.3f as a hard map", hard);
  return "<p class=\"note\"><b>Do not read the SSIM row alone.</b> " +
         chart::escaped(
             "Most of a depth map is empty room, and SSIM over the whole map mostly rewards "
             "leaving it empty: " +
             formatted(
                 "the empty room, as the answer to every record, scores %.3f; the first model "
                 "scores %s. ",
                 report.baselines.front().metrics[metric_ssim].mean, scores.c_str()) +
             "IoU, lateral error and ghost say whether the body is found, and on its side.") +
         "</p>\n";
}

std::string made_html(const Report& report) {
  std::string out = "<dl>";
  for (const auto& [name, text] : report.made)
    if (!text.empty())
      out += "<dt>" + chart::escaped(name) + "</dt><dd>" + chart::escaped(text) + "</dd>";
  return out + "</dl>\n";
}

std::string live_html(const Report& report) {
  if (!report.story) return {};
  if (!report.live) return story_html(*report.story);
  std::string out;
  for (const Problem& p : problems_of(report))
    if (p.live) out += chart::fail(p.text);
  return story_html(*report.story, out + live_table(report));
}

std::string records_html(const Report& report) {
  const bool one_sensor = std::any_of(report.modes.begin(), report.modes.end(),
                                      [](const auto& m) { return !both_sensors(m.inputs); });
  std::string out;
  for (const ShownRecord& shown : report.main) out += record_html(shown, report.span, one_sensor);
  return out;
}

std::string constants_note(const Report& report) {
  if (report.constants.empty()) return {};
  std::string files;
  for (const std::string& path : report.constants) files += (files.empty() ? "" : ", ") + path;
  return chart::note("Left out: " + files +
                     ". Such a model asks no sensor; its answer is always the mean of the training "
                     "maps, which is among the baselines.");
}

std::string terms_html() {
  constexpr std::pair<const char*, const char*> terms[] = {
      {"SPD", "single-photon detector of one pixel; its clicks are counted by time of flight."},
      {"record",
       "what the sensors saw in one time slot, with the map of the depth camera: the truth."},
      {"IoU", "intersection over union of the pixels of the body, in map and truth; 1 is perfect."},
      {"lateral error", "distance of the body's middle in the map from the true one, sideways."},
      {"depth error", "mean, over the pixels that are body in both maps."},
      {"ghost",
       "of the body that is drawn, beside the truth and beside its mirror image about the "
       "SPD's axis, how much is at the mirror image: 0 none, 0.5 as much; a little below "
       "0 by chance."},
      {"on the true side", "of the bodies more than 0.3 m off the axis."},
      {"hard map",
       "what is nearer to the background than to the mean body is set to the background."},
      {"domain shift",
       "how far a run as a whole is from runs like the training; above 1 is unusual."},
      {"flagged", "a single record that is unlike the training records."},
      {"SSIM, RMSE",
       "similarity of structure; root of the mean squared depth error, over the map."}};
  std::string out = "<dl>";
  for (const auto& [name, text] : terms)
    out += std::string("<dt>") + name + "</dt><dd>" + chart::escaped(text) + "</dd>";
  return out + "</dl>\n";
}

constexpr const char* cloud_style =
    "<style>#cloud-box{position:relative;overflow:hidden}#cloud{display:block;width:100%;touch-"
    "action:none;"
    "cursor:grab}#cloud-box "
    "span{position:absolute;transform:translate(4px,-50%);color:var(--quiet);"
    "font-size:13px;pointer-events:none}button{font:inherit;color:inherit;background:var(--paper);"
    "border:1px solid var(--edge);border-radius:6px;padding:4px "
    "12px;min-height:34px;cursor:pointer}"
    "button[aria-pressed=true]{background:var(--ink);color:var(--paper)}@media "
    "print{section[aria-labelledby=space]{display:none}}</style>";

void add_models(chart::Page& page, const Report& report) {
  if (!report.main.empty()) page.first(first_html(report.main.front(), report.span));
  page.first(first_table(report) + constants_note(report));
  page.section("failures", "What fails", failures_html(report));
  page.section("difference", "The difference", comparison_html(report));
  page.section("gallery", "Worst, median, best", gallery_html(report.gallery, report.span));
  page.section("errors", "Where the errors are", errors_html(report));
  page.section("labels", "By label", labels_html(report.modes.front()));
  page.section("metrics", "All metrics",
               all_table(report) + ssim_note(report) + paper_html(report));
  page.section("cost", "Cost", cost_table(report));
  page.section("records", "Records and their maps", records_html(report));
  if (!report.main.empty()) {
    page.section("space", "In space", cloud_style + cloud_html(report.main.front()));
    page.script(cloud_script(report.main.front(), report.span));
  }
}

}  // namespace

// Of compared models the file's name without its folder.
std::string short_name(const ModeResult& mode) {
  return mode.name.substr(mode.name.rfind('/') + 1);
}

std::string name_for_charts(const ModeResult& mode) {
  if (mode.name == "fused") return "both sensors";
  if (mode.name == "paper") return "the paper's network";
  if (mode.name == "spd") return "SPD alone";
  if (mode.name == "radar") return "radar alone";
  return short_name(mode);
}

std::string title_of(const ModeResult& mode) {
  std::string model = mode.evaluations.empty() ? "" : mode.evaluations.front().model;
  if (!mode.models.empty() && mode.models.front().papers) model = "the paper's network";
  if (model == "mean") model = "mean of the training maps";
  const std::string seeds =
      mode.evaluations.size() > 1 ? formatted(" (%zu trainings)", mode.evaluations.size()) : "";
  const std::string name = name_for_charts(mode);
  if (mode.name == "paper") return "both sensors, the paper's network" + seeds;
  if (name == short_name(mode)) return name + " (" + model + ")" + seeds;
  return name + ", " + model + seeds;
}

std::string to_html(const Report& report) {
  const bool compare = !report.differences.empty();
  chart::Page page(report.modes.empty() ? "A recorded run"
                   : compare            ? "Two models on the same records"
                                        : "Depth maps from one pixel and one radar");
  page.lead("<p class=\"verdict\">" + chart::escaped(verdict(report)) + "</p>\n" +
            first_failures(report) + "<p class=\"quiet\">" + chart::escaped(origin(report)) +
            "</p>\n");
  if (!report.modes.empty()) add_models(page, report);
  page.section("live", "The recorded run", live_html(report));
  page.section("training", "Training", losses_html(report));
  page.section("made", "How this was made", made_html(report));
  if (!report.modes.empty()) page.section("terms", "Terms", terms_html());
  return page.html();
}

std::string to_text(const Report& report) {
  std::string out = verdict(report) + "\n";
  for (const Problem& p : problems_of(report)) out += p.text + "\n";
  if (report.modes.empty()) return out;
  for (const std::string& path : report.constants)
    out += path + ": left out, its answer is always the mean of the training maps\n";
  out += formatted("%-10s %10s %16s %16s %16s %16s %16s\n", "mode", "paper SSIM", "SSIM", "IoU",
                   "lateral (m)", "ghost", "left/right");
  const auto line = [&](const std::string& name, const std::string& paper,
                        const Summaries& metrics) {
    out += formatted("%-10s %10s", name.c_str(), paper.c_str());
    for (const Metric m :
         {metric_ssim, metric_iou, metric_lateral_m, metric_ghost, metric_left_right})
      out += formatted(" %16s", formatted(metrics[m], " +-").c_str());
    out += '\n';
  };
  for (const auto& mode : report.modes)
    line(
        short_name(mode),
        mode.paper_ssim > 0 && mode.models.front().papers ? formatted("%.4f", mode.paper_ssim) : "",
        mode.metrics);
  for (const auto& row : report.baselines) line(row.name, "", row.metrics);
  for (const std::string& text : remarks_of(report.modes.front().evaluations.front()))
    out += text + "\n";
  for (const PairedDifference& d : report.differences)
    out += formatted("%-12s %6zu records: %.4f, %.4f; difference %+.4f (95 %%: %+.4f to %+.4f)\n",
                     metric_names[d.metric], d.records, d.first, d.second, d.mean, d.low, d.high);
  if (report.live) {
    line("live", "", report.live->metrics);
    for (const std::string& text : remarks_of(*report.live)) out += text + "\n";
  }
  return out;
}

}  // namespace echofuse::recon
