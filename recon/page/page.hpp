// SPDX-License-Identifier: MIT
// A page of HTML that needs nothing but itself: what there is to say and the numbers as JSON, which
// the scripts of the live page (recon/page) draw.
//   {"title", "verdict", "fails": [text], "more": text, "origin": text, "span": [near_m, far_m],
//    "records": [json_of(ShownRecord)], "first": [block],
//    "sections": [{"id", "heading", "blocks": [block]}]}
// A block has a "kind"; report.js has a function for each.
#pragma once
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

namespace echofuse::recon {

using Json = nlohmann::json;

Json paragraph(const std::string& text);
Json note(const std::string& text);                     // set off: what must be known
Json fails(const std::vector<std::string>& sentences);  // in red: what fails
Json details(const std::string& summary, const Json& blocks);

// A cell is a text, or cell(): with something small behind it, and a mark: "best", "good", "bad".
Json cell(const std::string& text, const std::string& small, const std::string& mark = {});
// The first cell of a row is its head. `baselines`: so many rows at the end are quiet. A head of
// words("which") is of a column of words, which stands at the left.
Json table(const std::string& caption, const Json& head, const Json& rows,
           std::size_t baselines = 0);
Json words(const std::string& head);

// A chart over x; each series has points of its own. Colours are those of the live page: "spd",
// "radar", "depth", "both", "papers", "grey". More of a chart: "log" (of y), "log_x", "span" (of
// y), "height", "ticks" and "note".
Json chart(const std::string& title, const std::string& x, const std::string& y);
enum class Look { dots, points, line, marked, steps };  // marked: a line with its points
// The series, for "bars", "names", "crossed" and "shaded" (report.js, Plot).
Json& add_series(Json& chart, const std::string& name, const std::string& colour, Look look,
                 std::span<const std::pair<double, double>> points);
// A line at this x, with its name; "across": at this y.
void add_rule(Json& chart, double at, const std::string& name);
Json charts(const std::vector<Json>& side_by_side);

// Five digits; a value that is no number is null.
Json short_number(double value);
// Little-endian integers in base64; a value is rounded to the next `unit`, and taken to their ends.
Json packed16(std::span<const float> values, double unit);
Json packed8(std::span<const float> values, double unit);

// "103 k"
std::string three_digits(double value);

const char* baseline_title(const std::string& name);  // "empty room" of "empty"

Json new_page(const std::string& title, const std::string& verdict, const std::string& origin);
// A section without blocks is left out.
void add_section(Json& page, const std::string& id, const std::string& heading, Json blocks);
std::string html_of(Json page);

}  // namespace echofuse::recon
