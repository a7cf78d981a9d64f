// SPDX-License-Identifier: MIT
#include "recon/page/page.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/core/bytes.hpp"
#include "drivers/program/printable.hpp"
#include "recon/numbers/text.hpp"
#include "recon/page/page_shell.hpp"

namespace echofuse::recon {
namespace {

std::string base64(ByteView bytes) {
  constexpr const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t three = 0;
    for (std::size_t k = 0; k < 3; ++k)
      three = three << 8 | (i + k < bytes.size() ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k)
      out += i + k > bytes.size() ? '=' : digits[three >> (18 - 6 * k) & 63];
  }
  return out;
}

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
  return base64(out);
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

Json& add_series(Json& chart, const std::string& name, const std::string& colour, Look look,
                 std::span<const std::pair<double, double>> points) {
  constexpr const char* looks[] = {"dots", "points", "line", "marked", "steps"};
  Json x = Json::array(), y = Json::array();
  for (const auto& [at, value] : points)
    x.push_back(short_number(at)), y.push_back(short_number(value));
  Json& series = chart["series"];
  series.push_back({{"name", name},
                    {"colour", colour},
                    {"look", looks[static_cast<std::size_t>(look)]},
                    {"x", std::move(x)},
                    {"y", std::move(y)}});
  return series.back();
}

void add_rule(Json& chart, double at, const std::string& name) {
  chart["rules"].push_back({{"at", short_number(at)}, {"name", name}});
}

Json charts(const std::vector<Json>& side_by_side) {
  return {{"kind", "charts"}, {"blocks", side_by_side}};
}

std::string three_digits(double value) {
  if (!(std::abs(value) > 0)) return "0";
  const double unit = std::pow(10, std::floor(std::log10(std::abs(value))) - 2);
  const double rounded = std::round(value / unit) * unit, size = std::abs(rounded);
  if (size >= 1e6) return formatted("%.4g M", rounded / 1e6);
  if (size >= 1e4) return formatted("%.4g k", rounded / 1e3);
  return formatted("%.4g", rounded);
}

Json short_number(double value) {
  if (!std::isfinite(value)) return nullptr;
  return std::stod(formatted("%.5g", value));
}

Json packed16(std::span<const float> values, double unit) { return packed(values, unit, 2); }
Json packed8(std::span<const float> values, double unit) { return packed(values, unit, 1); }

const char* baseline_title(const std::string& name) {
  if (name == "empty") return "empty room";
  if (name == "mean") return "mean of the training maps";
  return "nearest training record";
}

Json new_page(const std::string& title, const std::string& verdict, const std::string& origin) {
  return {{"title", title},
          {"verdict", verdict},
          {"origin", origin},
          {"fails", Json::array()},
          {"more", ""},
          {"span", {0, 1}},
          {"records", Json::array()},
          {"first", Json::array()},
          {"sections", Json::array()}};
}

void add_section(Json& page, const std::string& id, const std::string& heading, Json blocks) {
  if (!blocks.empty())
    page["sections"].push_back({{"id", id}, {"heading", heading}, {"blocks", std::move(blocks)}});
}

std::string html_of(Json page) {
  make_printable(page);
  const std::string shell(page_shell());
  const std::string place = "{{data}}";
  // A "<" could end the script, or begin a comment that hides its end.
  std::string data = page.dump();
  for (std::size_t at = 0; (at = data.find('<', at)) != std::string::npos;)
    data.replace(at, 1, "\\u003c");
  const std::size_t at = shell.find(place);
  return shell.substr(0, at) + data + shell.substr(at + place.size());
}

}  // namespace echofuse::recon
