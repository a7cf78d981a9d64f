// SPDX-License-Identifier: MIT
#include "recon/page/page.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/chart/style.hpp"
#include "drivers/program/printable.hpp"
#include "recon/numbers/text.hpp"
#include "recon/page/page_shell.hpp"

namespace echofuse::recon {
namespace {

Json packed(std::span<const float> values, double unit, std::size_t bytes) {
  const double most = bytes == 1 ? 255 : 65535;
  Bytes out;
  out.reserve(bytes * values.size());
  for (const float v : values) {
    const double steps = std::isnan(v) ? 0 : std::clamp(double{v} / unit, 0.0, most);
    const auto rounded = static_cast<unsigned>(std::lround(steps));
    out.push_back(static_cast<std::uint8_t>(rounded & 255));
    if (bytes == 2) out.push_back(static_cast<std::uint8_t>(rounded >> 8));
  }
  return chart::base64(out);
}

// Texts that came from outside, in one line each, without what reorders them.
void make_printable(Json& json) {
  if (json.is_string()) json = printable(json.get_ref<const std::string&>());
  if (json.is_structured())
    for (Json& part : json) make_printable(part);
}

}  // namespace

Json paragraph(const std::string& text) { return {{"kind", "text"}, {"text", text}}; }
Json note(const std::string& text) { return {{"kind", "note"}, {"text", text}}; }

Json fails(const std::vector<std::string>& sentences) {
  return {{"kind", "fails"}, {"items", sentences}};
}

Json details(const std::string& summary, const Json& blocks) {
  return {{"kind", "details"}, {"summary", summary}, {"blocks", blocks}};
}

Json cell(const std::string& text, const std::string& small, const std::string& mark) {
  Json out{{"text", text}};
  if (!small.empty()) out["small"] = small;
  if (!mark.empty()) out["mark"] = mark;
  return out;
}

Json table(const std::string& caption, const Json& head, const Json& rows, std::size_t baselines) {
  return {{"kind", "table"},
          {"caption", caption},
          {"head", head},
          {"rows", rows},
          {"baselines", baselines}};
}

Json words(const std::string& head) { return {{"text", head}, {"words", true}}; }

Json chart(const std::string& title, const std::string& x, const std::string& y) {
  return {{"kind", "chart"}, {"title", title},          {"x", x},
          {"y", y},          {"series", Json::array()}, {"rules", Json::array()}};
}

void add_series(Json& chart, const std::string& name, const char* colour, Look look,
                std::span<const std::pair<double, double>> points) {
  constexpr const char* looks[] = {"dots", "line", "marked", "steps"};
  Json x = Json::array(), y = Json::array();
  for (const auto& [at, value] : points)
    x.push_back(short_number(at)), y.push_back(short_number(value));
  chart["series"].push_back({{"name", name},
                             {"colour", colour},
                             {"look", looks[static_cast<std::size_t>(look)]},
                             {"x", std::move(x)},
                             {"y", std::move(y)}});
}

void add_rule(Json& chart, double at, const std::string& name) {
  chart["rules"].push_back({{"at", short_number(at)}, {"name", name}});
}

Json charts(const std::vector<Json>& side_by_side) {
  return {{"kind", "charts"}, {"blocks", side_by_side}};
}

Json short_number(double value) {
  if (!std::isfinite(value)) return nullptr;
  return std::stod(formatted("%.5g", value));
}

Json packed16(std::span<const float> values, double unit) { return packed(values, unit, 2); }
Json packed8(std::span<const float> values, double unit) { return packed(values, unit, 1); }

void add_section(Json& page, const std::string& id, const std::string& heading, Json blocks) {
  if (!blocks.empty())
    page["sections"].push_back({{"id", id}, {"heading", heading}, {"blocks", std::move(blocks)}});
}

std::string html_of(Json page) {
  make_printable(page);
  const std::string shell(page_shell());
  const std::string place = "{{data}}", title = "{{title}}";
  // Within a script no "</" may stand.
  std::string data = page.dump();
  for (std::size_t at = 0; (at = data.find("</", at)) != std::string::npos; at += 3)
    data.insert(at + 1, 1, '\\');
  const std::size_t name = shell.find(title), at = shell.find(place);
  return shell.substr(0, name) + chart::escaped(page.at("title").get<std::string>()) +
         shell.substr(name + title.size(), at - name - title.size()) + data +
         shell.substr(at + place.size());
}

}  // namespace echofuse::recon
