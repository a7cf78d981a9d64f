// SPDX-License-Identifier: MIT
// The maps of a report.
#include <algorithm>
#include <array>
#include <cmath>

#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"
#include "recon/files/text.hpp"
#include "recon/output/cloud_page.hpp"
#include "recon/output/map_pictures.hpp"
#include "recon/output/report_page.hpp"

namespace echofuse::recon {
namespace {

std::string scores_of(const ShownMap& m) {
  std::string out = formatted("IoU %.2f", m.scores[metric_iou]);
  if (!std::isnan(m.scores[metric_lateral_m]))
    out += formatted(", side %.1f cm", 100 * m.scores[metric_lateral_m]);
  if (!std::isnan(m.scores[metric_depth_mae_m]))
    out += formatted(", depth %.1f cm off", 100 * m.scores[metric_depth_mae_m]);
  return out;
}

// One for all maps of a record.
Frame frame_of(const ShownRecord& r) {
  std::vector<float> any = r.maps.front().map;
  for (const ShownMap& m : r.maps)
    for (std::size_t p = 0; p < any.size(); ++p) any[p] = std::max(any[p], m.map[p]);
  return frame_about(r.truth, any, r.half_tangent);
}

chart::Drawing truth_of(const ShownRecord& r) {
  return chart::draw(map_picture("Truth (depth camera)", r.truth, frame_of(r), r.span));
}

std::vector<chart::Drawing> map_of(const ShownRecord& r, const ShownMap& m, bool deviation) {
  chart::Picture map = map_picture("Map: " + m.name, m.map, frame_of(r), r.span);
  map.note = scores_of(m);
  std::vector<chart::Drawing> out{chart::draw(map),
                                  chart::draw(error_picture(m.map, r.truth, frame_of(r)))};
  if (deviation && !m.deviation.empty()) {
    chart::Picture sd = deviation_picture(m.deviation, frame_of(r));
    sd.note = m.stated;
    out.push_back(chart::draw(sd));
  }
  return out;
}

std::vector<chart::Drawing> measured_of(const ShownRecord& r) {
  std::vector<chart::Drawing> out;
  for (chart::Panel panel : r.measured) {
    panel.width = 370;
    out.push_back(chart::draw(panel));
  }
  return out;
}

// The whole field, as a mirror image may be on its other side.
std::vector<chart::Drawing> blur_of(const ShownRecord& r) {
  const Frame whole = whole_frame(
      static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(r.truth.size())))),
      r.half_tangent);
  chart::Picture truth = map_picture("Truth (depth camera)", r.truth, whole, r.span);
  truth.width = 320;
  std::vector<chart::Drawing> out{chart::draw(truth)};
  for (const ShownMap& m : r.maps) {
    chart::Picture p = share_picture(m.name, m.share, whole);
    p.width = 320;
    out.push_back(chart::draw(p));
  }
  return out;
}

std::vector<std::string> svgs(const std::vector<chart::Drawing>& drawings) {
  std::vector<std::string> out;
  for (const auto& d : drawings) out.push_back(d.svg);
  return out;
}

// What the model says of its map; `named`: one of several models.
std::string words_of(const ShownMap& m, bool named) {
  std::string out;
  const std::string who = named ? m.name : "The model";
  if (!m.stated.empty()) out += who + " states: " + m.stated + ". ";
  if (!m.warning.empty()) out += who + " warns: " + m.warning + ". ";
  return out;
}

chart::Picture letter_picture(const ShownLetter& l, const std::string& title,
                              const std::vector<float>& map) {
  chart::Picture p = map_picture(
      title, map,
      whole_frame(static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(map.size())))),
                  l.width_m / 2),
      l.span);
  p.degrees = false, p.x_title = "x from the plate's middle (m)", p.y_title = "y (m)";
  return p;
}

// How alike what is seen is to each letter; the true one is marked.
chart::Panel candidates(const ShownLetter& l) {
  chart::Panel out{"How alike to each letter", {"correlation"}, {"letter"}, {}};
  chart::Series truth{"", {}, chart::grey, chart::Look::markers},
      map{"", {}, 0, chart::Look::markers};
  for (std::size_t k = 0; k < letters.size(); ++k) {
    const double y = static_cast<double>(letters.size() - 1 - k);
    const bool is = k == l.letter;
    out.y.ticks.emplace_back(y, std::string(1, letters[k]) + (is ? " (true)" : ""));
    truth.points.push_back({l.truth_scores[k], y});
    map.points.push_back({l.map_scores[k], y, chart::nan, chart::nan, is ? "map" : ""});
    if (is) truth.points.back().label = "true map";
  }
  out.series = {truth, map};
  out.width = 370, out.height = 330;
  return out;
}

}  // namespace

std::string stand_alone(const ShownRecord& r) {
  std::vector<chart::Drawing> drawings{truth_of(r)};
  for (auto& d : measured_of(r)) drawings.push_back(std::move(d));
  for (const ShownMap& m : r.maps) {
    for (auto& d : map_of(r, m, true)) drawings.push_back(std::move(d));
    if (drawings.size() % 3 != 0)
      drawings.push_back(chart::no_picture("Its own uncertainty", "not stated", 370));
  }
  return chart::stand_alone(r.title, drawings, 3);
}

std::string blur_alone(const ShownRecord& r) {
  const auto drawings = blur_of(r);
  return chart::stand_alone(
      r.title + ": how far each pixel has come from the room (0) to a body (1)", drawings,
      drawings.size());
}

std::string first_html(const ShownRecord& r) {
  std::vector<chart::Drawing> drawings{truth_of(r)};
  for (auto& d : map_of(r, r.maps.front(), false)) drawings.push_back(std::move(d));
  return chart::figure(svgs(drawings),
                       r.title + ". " + r.caption + " " + words_of(r.maps.front(), false));
}

std::string record_html(const ShownRecord& r) {
  std::vector<chart::Drawing> drawings = measured_of(r);
  std::string said;
  for (const ShownMap& m : r.maps) {
    for (auto& d : map_of(r, m, true)) drawings.push_back(std::move(d));
    said += words_of(m, r.maps.size() > 1);
  }
  drawings.insert(drawings.begin(), truth_of(r));
  return "<h3>" + chart::escaped(r.title) + "</h3>\n" +
         chart::figure(svgs(drawings), r.caption + " " + said + "File: " + r.file + ".svg") +
         chart::figure(svgs(blur_of(r)),
                       "How far each pixel has come from the room (0) to a body (1); above a half "
                       "it is shown as "
                       "one. A sensor alone leaves open on which side the body is: a blur. File: " +
                           r.file + "_blur.svg");
}

std::string gallery_html(const std::vector<ShownRecord>& gallery) {
  std::string out;
  for (const ShownRecord& r : gallery) {
    std::vector<chart::Drawing> drawings{truth_of(r)};
    for (auto& d : map_of(r, r.maps.front(), false)) drawings.push_back(std::move(d));
    out += "<h3>" + chart::escaped(r.title) + "</h3>\n" +
           chart::figure(svgs(drawings), words_of(r.maps.front(), false));
  }
  return out;
}

std::string letters_html(const std::vector<ShownLetter>& all) {
  std::string out;
  for (const ShownLetter& l : all) {
    const auto best = static_cast<std::size_t>(
        std::max_element(l.map_scores.begin(), l.map_scores.end()) - l.map_scores.begin());
    const std::string read = std::string("The map reads as ") + letters[best] +
                             (best == l.letter ? ", which is right." : ", which is wrong.");
    out += "<h3>" + chart::escaped(l.title) + "</h3>\n" +
           chart::figure({chart::draw(letter_picture(l, "Truth, zoomed", l.truth)).svg,
                          chart::draw(letter_picture(l, "Map, zoomed", l.map)).svg,
                          chart::draw(candidates(l)).svg},
                         read);
  }
  return out.empty()
             ? out
             : chart::paragraph("Of all records with a letter those at the quartiles of IoU.") +
                   out;
}

std::string cloud_html(const ShownRecord& r) {
  return chart::paragraph(r.title + ": drag to turn, wheel for the distance, arrow keys.") +
         "<figure class=\"screen\"><p><button type=\"button\" id=\"cloud-map\" "
         "aria-pressed=\"true\">Map</button> "
         "<button type=\"button\" id=\"cloud-truth\" aria-pressed=\"false\">Truth</button></p>"
         "<div id=\"cloud-box\"><canvas id=\"cloud\" tabindex=\"0\" aria-label=\"points in space\">"
         "</canvas></div></figure>\n";
}

// Depths in millimetres.
std::string cloud_script(const ShownRecord& r) {
  const auto list = [](const std::vector<float>& map) {
    std::string out;
    for (const float z : map) out += std::to_string(std::lround(1000 * double{z})) + ",";
    if (!out.empty()) out.pop_back();
    return "[" + out + "].map(v=>v/1000)";
  };
  return "(()=>{\n" + std::string(cloud_code) + "\nconst shown={map:" + list(r.maps.front().map) +
         ",truth:" + list(r.truth) +
         "};const cloud=new Cloud();\nconst show=which=>{cloud.set(shown[which]," +
         formatted("%g,[%g,%g]", r.half_tangent, r.span.near, r.span.far) +
         ");for(const w of ['map','truth'])document.getElementById('cloud-'+w)"
         ".setAttribute('aria-pressed',w===which);};\n"
         "for(const w of ['map','truth'])document.getElementById('cloud-'+w)"
         ".addEventListener('click',()=>show(w));\nshow('map');\n})();\n";
}

}  // namespace echofuse::recon
