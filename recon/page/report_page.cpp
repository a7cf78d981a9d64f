// SPDX-License-Identifier: MIT
// The page of a report as JSON, and its text.
#include "recon/page/report_page.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "drivers/program/console.hpp"
#include "recon/numbers/text.hpp"

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

// This is what the numbers of this very table say about whole-map SSIM.
Json ssim_note(const Report& report) {
  const Summaries& own = report.modes.front().metrics;
  const double raw = own[metric_ssim].mean, hard = own[metric_ssim_hard].mean;
  std::string scores = formatted("%.3f", raw);
  if (std::abs(raw - hard) >= 5e-4) scores += formatted(" raw and %.3f as a hard map", hard);
  return note(
      "Do not read the SSIM row alone. Most of a depth map is empty room, and SSIM over the whole "
      "map mostly rewards leaving it empty: " +
      formatted("the empty room, as the answer to every record, scores %.3f; the first model "
                "scores %s. ",
                report.baselines.front().metrics[metric_ssim].mean, scores.c_str()) +
      "IoU, lateral error and ghost say whether the body is found, and on its side.");
}

Json made(const Report& report) {
  Json rows = Json::array();
  for (const auto& [name, text] : report.made)
    if (!text.empty()) rows.push_back(Json::array({name, text}));
  return Json::array({{{"kind", "list"}, {"rows", rows}}});
}

Json terms() {
  constexpr std::pair<const char*, const char*> all[] = {
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
      {"p",
       "of a run as a whole: how probably a run like the training is as far from it; below 0.001 "
       "the run is unlike the training."},
      {"flagged", "a single record that is unlike the training records."},
      {"SSIM, RMSE",
       "similarity of structure; root of the mean squared depth error, over the map."}};
  Json rows = Json::array();
  for (const auto& [name, text] : all) rows.push_back(Json::array({name, text}));
  return Json::array({{{"kind", "list"}, {"rows", rows}}});
}

Json live(const Report& report) {
  if (!report.story) return Json::array();
  Json between = Json::array();
  if (report.live) {
    std::vector<std::string> failing;
    for (const Problem& p : problems_of(report))
      if (p.live) failing.push_back(p.text);
    if (!failing.empty()) between.push_back(fails(failing));
    for (const Json& block : live_table(report)) between.push_back(block);
  }
  return story_blocks(*report.story, between);
}

// Pictures of a record of the page's list, each "truth", "spd", "radar", or "map", "error",
// "deviation" and "share" with the number of its model.
Json pictures(std::size_t record, std::vector<std::string> show, const std::string& caption) {
  return {{"kind", "pictures"}, {"record", record}, {"show", show}, {"caption", caption}};
}

std::string of_model(const char* what, std::size_t model) {
  return std::string(what) + " " + std::to_string(model);
}

// The subject's map of the first record, or both of a comparison, beside the truth.
Json first_pictures(const Report& report) {
  const ShownRecord& shown = report.main.front();
  std::vector<std::string> show{"truth"};
  std::string said = shown.caption + " ";
  const std::size_t models = report.differences.empty() ? 1 : 2;
  for (const char* what : {"map", "error"})
    for (std::size_t m = 0; m < models; ++m) show.push_back(of_model(what, m));
  for (std::size_t m = 0; m < models; ++m) said += words_of(shown.maps[m], models > 1);
  Json out = pictures(0, show,
                      said + formatted("All maps of this page are over the same depths, %g to %g "
                                       "m. Of an error hatched is what is missed, dotted what is "
                                       "invented.",
                                       report.span.near, report.span.far));
  out["title"] = shown.title;
  out["compare"] = models > 1;
  return out;
}

Json record_blocks(const Report& report) {
  const bool one_sensor = std::any_of(report.modes.begin(), report.modes.end(),
                                      [](const auto& m) { return m.takes.ends_with("alone"); });
  Json out = Json::array();
  for (std::size_t i = 0; i < report.main.size(); ++i) {
    const ShownRecord& shown = report.main[i];
    std::vector<std::string> show{"truth"}, shares{"truth"};
    if (shown.spd_axis.count > 0) show.emplace_back("spd");
    if (shown.radar_axis.count > 0) show.emplace_back("radar");
    std::string said = shown.caption + " ";
    for (std::size_t m = 0; m < shown.maps.size(); ++m) {
      for (const char* what : {"map", "error"}) show.push_back(of_model(what, m));
      if (!shown.maps[m].deviation.empty()) show.push_back(of_model("deviation", m));
      shares.push_back(of_model("share", m));
      said += words_of(shown.maps[m], shown.maps.size() > 1);
    }
    Json blur = pictures(
        i, shares,
        std::string("How far each pixel has come from the room (0) to a body (1); above a "
                    "half it is shown as one.") +
            (one_sensor ? " A sensor alone leaves open on which side the body is: a blur." : ""));
    blur["whole"] = true;
    out.push_back(details(
        shown.title,
        Json::array({pictures(i, show,
                              said + "The uncertainty is the standard deviation of the depth; "
                                     "most of it is whether there is body or wall."),
                     blur})));
  }
  return out;
}

// Worst, median and best, a column each.
Json gallery(const Report& report) {
  Json columns = Json::array();
  for (std::size_t i = 0; i < report.gallery.size(); ++i) {
    Json column = pictures(report.main.size() + i, {"truth", "map 0", "error 0"},
                           words_of(report.gallery[i].maps.front(), false));
    column["title"] = report.gallery[i].title;
    columns.push_back(column);
  }
  if (columns.empty()) return columns;
  return Json::array({{{"kind", "columns"}, {"blocks", columns}}});
}

void add_models(Json& page, const Report& report) {
  Json& first = page["first"];
  if (!report.main.empty()) first.push_back(first_pictures(report));
  for (const Json& block : first_table(report)) first.push_back(block);
  for (const auto* list : {&report.main, &report.gallery})
    for (const ShownRecord& shown : *list) page["records"].push_back(json_of(shown));
  add_section(page, "failures", "What fails", failures(report));
  add_section(page, "difference", "The difference", comparison(report));
  add_section(page, "gallery", "Worst, median, best", gallery(report));
  add_section(page, "errors", "Where the errors are", errors(report));
  add_section(page, "labels", "By label", labels_table(report.modes.front()));
  Json metrics = all_table(report);
  metrics.push_back(ssim_note(report));
  for (const Json& block : beside_paper(report)) metrics.push_back(block);
  add_section(page, "metrics", "All metrics", metrics);
  add_section(page, "cost", "Cost", cost_table(report));
  add_section(page, "records", "Records and their maps", record_blocks(report));
  if (!report.main.empty())
    add_section(page, "space", "In space", Json::array({{{"kind", "cloud"}, {"record", 0}}}));
}

}  // namespace

// Of compared models it is the file's name without its folder.
std::string short_name(const ModeResult& mode) {
  return mode.name.substr(mode.name.rfind('/') + 1);
}

std::string title_of(const ModeResult& mode) {
  const std::string kind = !mode.models.empty() && mode.models.front().papers
                               ? "the paper's network"
                           : mode.evaluations.empty() ? ""
                                                      : mode.evaluations.front().model;
  const std::string seeds =
      mode.evaluations.size() > 1 ? formatted("; %zu trainings", mode.evaluations.size()) : "";
  const std::string name = short_name(mode);
  return name + " (" + (kind == name ? "" : kind + ", ") + mode.takes + seeds + ")";
}

Json page_of(const Report& report) {
  constexpr std::size_t most = 4;  // failures of the first screen; the others are in their section
  Json page = new_page(report.modes.empty()          ? "A recorded run"
                       : !report.differences.empty() ? "Two models on the same records"
                                                     : "Depth maps from one pixel and one radar",
                       verdict(report), origin(report));
  page["span"] = {report.span.near, report.span.far};
  const auto problems = problems_of(report);
  for (std::size_t i = 0; i < std::min(most, problems.size()); ++i)
    page["fails"].push_back(problems[i].text);
  if (!problems.empty() && !report.modes.empty())
    page["more"] = (problems.size() > most ? formatted("%zu more, and", problems.size() - most)
                                           : std::string("Numbers, and")) +
                   " which records";
  if (!report.modes.empty()) add_models(page, report);
  add_section(page, "live", "The recorded run", live(report));
  add_section(page, "training", "Training", losses(report));
  add_section(page, "made", "How this was made", made(report));
  if (!report.modes.empty()) add_section(page, "terms", "Terms", terms());
  return page;
}

std::string to_text(const Report& report) {
  std::string out = verdict(report) + "\n";
  for (const Problem& p : problems_of(report)) out += p.text + "\n";
  if (report.modes.empty()) return out;
  std::size_t widest = 10;
  for (const auto& mode : report.modes) widest = std::max(widest, title_of(mode).size());
  const int wide = static_cast<int>(widest);
  out += formatted("%-*s %10s %16s %16s %16s %16s %16s\n", wide, "model", "paper SSIM", "SSIM",
                   "IoU", "lateral (m)", "ghost", "left/right");
  const auto line = [&](const std::string& name, const std::string& paper,
                        const Summaries& metrics) {
    out += formatted("%-*s %10s", wide, name.c_str(), paper.c_str());
    for (const Metric m :
         {metric_ssim, metric_iou, metric_lateral_m, metric_ghost, metric_left_right})
      out += formatted(" %16s", formatted(metrics[m], " +-").c_str());
    out += '\n';
  };
  for (const auto& mode : report.modes) {
    const double paper = paper_ssim(mode);
    line(title_of(mode), paper > 0 ? formatted("%.4f", paper) : "", mode.metrics);
  }
  for (const auto& row : report.baselines) line(row.name, "", row.metrics);
  for (const std::string& text : remarks_of(report.modes.front().evaluations.front()))
    out += text + "\n";
  if (!report.differences.empty())
    out += "Second against first; a difference with plus: the second is better.\n";
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
