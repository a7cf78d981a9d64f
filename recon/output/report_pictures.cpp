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
    out += formatted(", lateral error %.1f cm", 100 * m.scores[metric_lateral_m]);
  if (!std::isnan(m.scores[metric_depth_mae_m]))
    out += formatted(", depth error %.1f cm", 100 * m.scores[metric_depth_mae_m]);
  return out + ".";
}

// One for all maps of a record.
Frame frame_of(const ShownRecord& r) {
  std::vector<float> any = r.maps.front().map;
  for (const ShownMap& m : r.maps)
    for (std::size_t p = 0; p < any.size(); ++p) any[p] = std::max(any[p], m.map[p]);
  return frame_about(r.truth, any, r.half_tangent);
}

chart::Drawing truth_of(const ShownRecord& r, const chart::Span& span) {
  return chart::draw(map_picture("Truth (depth camera)", r.truth, frame_of(r), span));
}

chart::Drawing map_of(const ShownRecord& r, const ShownMap& m, const std::string& title,
                      const chart::Span& span) {
  chart::Picture map = map_picture(title, m.map, frame_of(r), span);
  map.note = scores_of(m) + (map.note.empty() ? "" : " " + map.note);
  return chart::draw(map);
}

chart::Drawing error_of(const ShownRecord& r, const ShownMap& m) {
  return chart::draw(error_picture(m.map, r.truth, frame_of(r)));
}

// Map, error and stated uncertainty.
std::vector<chart::Drawing> all_of(const ShownRecord& r, const ShownMap& m,
                                   const chart::Span& span) {
  std::vector<chart::Drawing> out{map_of(r, m, "Map: " + m.name, span), error_of(r, m)};
  if (!m.deviation.empty()) {
    chart::Picture sd = deviation_picture(m.deviation, frame_of(r));
    sd.note = "Place of the body: " + m.stated + "." + (sd.note.empty() ? "" : " " + sd.note);
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
std::vector<chart::Drawing> blur_of(const ShownRecord& r, const chart::Span& span) {
  const Frame whole = whole_frame(
      static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(r.truth.size())))),
      r.half_tangent);
  chart::Picture truth = map_picture("Truth (depth camera)", r.truth, whole, span);
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

}  // namespace

std::string stand_alone(const ShownRecord& r, const chart::Span& span) {
  std::vector<chart::Drawing> drawings{truth_of(r, span)};
  for (auto& d : measured_of(r)) drawings.push_back(std::move(d));
  for (const ShownMap& m : r.maps) {
    for (auto& d : all_of(r, m, span)) drawings.push_back(std::move(d));
    if (drawings.size() % 3 != 0)
      drawings.push_back(chart::no_picture("Stated uncertainty", "not stated", 370));
  }
  drawings.push_back(chart::map_legend(1140, 4));
  return chart::stand_alone(r.title, drawings, 3);
}

std::string maps_alone(const ShownRecord& r, const chart::Span& span) {
  std::vector<chart::Drawing> drawings{truth_of(r, span)};
  for (const ShownMap& m : r.maps) drawings.push_back(map_of(r, m, m.name, span));
  return chart::stand_alone("", drawings, drawings.size());
}

std::string blur_alone(const ShownRecord& r, const chart::Span& span) {
  const auto drawings = blur_of(r, span);
  return chart::stand_alone(
      r.title + ": how far each pixel has come from the room (0) to a body (1)", drawings,
      drawings.size());
}

std::string first_html(const ShownRecord& r, const chart::Span& span) {
  const ShownMap& m = r.maps.front();
  std::vector<std::string> drawings =
      svgs({truth_of(r, span), map_of(r, m, "Map: " + m.name, span), error_of(r, m)});
  drawings.push_back(
      chart::for_both_widths(chart::map_legend(1140, 4), chart::map_legend(chart::narrow_px, 1)));
  return chart::figure(drawings, r.title + ". " + r.caption + " " + words_of(m, false) +
                                     formatted("All maps of this page have the depths of this "
                                               "one, %g to %g m.",
                                               span.near, span.far));
}

std::string record_html(const ShownRecord& r, const chart::Span& span, bool one_sensor) {
  std::vector<chart::Drawing> drawings = measured_of(r);
  std::string said;
  for (const ShownMap& m : r.maps) {
    for (auto& d : all_of(r, m, span)) drawings.push_back(std::move(d));
    said += words_of(m, r.maps.size() > 1);
  }
  drawings.insert(drawings.begin(), truth_of(r, span));
  return chart::details(
      r.title,
      chart::figure(svgs(drawings), r.caption + " " + said +
                                        "Stated uncertainty: standard deviation of the "
                                        "depth; most of it is whether there is body or "
                                        "wall. File: " +
                                        r.file + ".svg") +
          chart::figure(svgs(blur_of(r, span)),
                        "How far each pixel has come from the room (0) to a body (1); above a half "
                        "it is shown as one. " +
                            std::string(one_sensor ? "A sensor alone leaves open on which side the "
                                                     "body is: a blur. "
                                                   : "") +
                            "File: " + r.file + "_blur.svg"));
}

// A column each.
std::string gallery_html(const std::vector<ShownRecord>& gallery, const chart::Span& span) {
  std::string out;
  for (const ShownRecord& r : gallery) {
    const ShownMap& m = r.maps.front();
    out += "<div><h3>" + chart::escaped(r.title) + "</h3><div class=\"drawings\">" +
           map_of(r, m, "Map", span).svg + error_of(r, m).svg + "</div>" +
           chart::paragraph(words_of(m, false)) + "</div>";
  }
  return out.empty() ? out : "<figure><div class=\"groups\">" + out + "</div></figure>\n";
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
std::string cloud_script(const ShownRecord& r, const chart::Span& span) {
  const auto list = [](const std::vector<float>& map) {
    std::string out;
    for (const float z : map) out += std::to_string(std::lround(1000 * double{z})) + ",";
    if (!out.empty()) out.pop_back();
    return "[" + out + "].map(v=>v/1000)";
  };
  return "(()=>{\n" + std::string(cloud_code) + "\nconst shown={map:" + list(r.maps.front().map) +
         ",truth:" + list(r.truth) +
         "};const cloud=new Cloud();\nconst show=which=>{cloud.set(shown[which]," +
         formatted("%g,[%g,%g]", r.half_tangent, span.near, span.far) +
         ");for(const w of ['map','truth'])document.getElementById('cloud-'+w)"
         ".setAttribute('aria-pressed',w===which);};\n"
         "for(const w of ['map','truth'])document.getElementById('cloud-'+w)"
         ".addEventListener('click',()=>show(w));\nshow('map');\n})();\n";
}

}  // namespace echofuse::recon
