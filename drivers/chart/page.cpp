// SPDX-License-Identifier: MIT
#include "drivers/chart/page.hpp"

#include "drivers/chart/style.hpp"

namespace echofuse::chart {
namespace {

constexpr const char* page_style = R"(*{box-sizing:border-box}
body{margin:0 auto;padding:16px 20px 48px;max-width:1240px;background:var(--back);color:var(--ink);
font:16px/1.45 system-ui,"DejaVu Sans",sans-serif;font-variant-numeric:tabular-nums}
h1{font-size:24px;line-height:1.2;margin:0 0 4px}h2{font-size:20px;margin:40px 0 8px;padding-top:8px;border-top:2px solid var(--edge)}
h3{font-size:16px;margin:20px 0 4px}p{max-width:78ch;margin:8px 0;overflow-wrap:anywhere}
a{color:var(--c0)}:focus-visible{outline:3px solid var(--c0);outline-offset:2px}
.verdict{font-size:20px;line-height:1.35;max-width:96ch;font-weight:600}
.quiet,figcaption,caption{color:var(--quiet);fill:var(--quiet)}
nav{margin:12px 0}nav ul{display:flex;flex-wrap:wrap;gap:4px 18px;list-style:none;margin:0;padding:0}
.scroll{overflow-x:auto;margin:12px 0}table{border-collapse:collapse;font-size:15px;background:var(--paper)}
caption{text-align:left;padding:0 0 4px;font-size:14px}
th,td{padding:5px 12px;border-bottom:1px solid var(--grid);text-align:right;vertical-align:top}
thead th{vertical-align:bottom;border-bottom:2px solid var(--edge);font-weight:600;line-height:1.25}
th:first-child,td:first-child{text-align:left}tbody th{font-weight:600}td small,th small{color:var(--quiet);font-weight:400}
tr.baseline th{font-weight:400}tr.baseline>*{color:var(--quiet)}
td b.best{color:var(--good)}td b.best::after{content:" best";font-size:12px;font-weight:600}
td.words{text-align:left}td small{white-space:nowrap}
.wide table{font-size:13px}.wide th,.wide td{padding:5px 8px}.wide b.best::after{content:""}.wide b.best{text-decoration:underline}
.good{color:var(--good)}.look{color:var(--look)}.bad{color:var(--bad)}
.note{border-left:4px solid var(--look);background:var(--look-paper);padding:8px 14px;margin:12px 0}
.fail{border-left:4px solid var(--bad);background:var(--bad-paper);padding:8px 14px;margin:12px 0;max-width:78ch}
figure{margin:14px 0;padding:12px;background:var(--paper);border:1px solid var(--grid);border-radius:8px}
.drawings{display:flex;flex-wrap:wrap;gap:12px 20px;align-items:flex-start}
.drawings>svg{max-width:100%;height:auto;flex:0 1 auto}
figcaption{margin-top:8px;font-size:14px;max-width:90ch}
details{margin:12px 0}summary{cursor:pointer;font-weight:600}
pre{white-space:pre-wrap;overflow-wrap:anywhere;background:var(--paper);border:1px solid var(--grid);border-radius:6px;padding:8px 12px;font-size:14px}
dl{display:grid;grid-template-columns:max-content minmax(0,1fr);gap:4px 16px;margin:12px 0}dt{color:var(--quiet)}dd{margin:0;overflow-wrap:anywhere}
@media (max-width:640px){body{padding:12px 12px 32px}dl{grid-template-columns:minmax(0,1fr)}dd{margin-bottom:6px}
.verdict{font-size:18px}th,td{padding:5px 8px}table{font-size:14px}figure{padding:8px}}
@media print{body{max-width:none;background:#fff;padding:0;font-size:11pt}nav,.screen{display:none}
figure,table,.note,.fail{break-inside:avoid}h2,h3{break-after:avoid}.scroll{overflow:visible}.drawings>svg{max-width:48%}}
)";

}  // namespace

void Page::section(const std::string& id, const std::string& heading, const std::string& html) {
  if (!html.empty()) sections_.push_back({id, heading, html});
}

std::string Page::html() const {
  std::string out =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width,initial-scale=1\"><title>" +
      escaped(title_) + "</title><style>\n" + page_colours() + page_style + drawing_style(true) +
      "</style></head><body>\n<header><h1>" + escaped(title_) + "</h1>\n" + lead_ + "</header>\n";
  std::string contents;
  for (const Section& s : sections_)
    contents += "<li><a href=\"#" + s.id + "\">" + escaped(s.heading) + "</a></li>";
  if (sections_.size() > 1) out += "<nav aria-label=\"Contents\"><ul>" + contents + "</ul></nav>\n";
  out += "<main>\n";
  for (const Section& s : sections_)
    out += "<section aria-labelledby=\"" + s.id + "\"><h2 id=\"" + s.id + "\">" +
           escaped(s.heading) + "</h2>\n" + s.html + "</section>\n";
  out += "</main>\n";
  if (!script_.empty()) out += "<script>\n" + script_ + "</script>\n";
  return out + "</body></html>\n";
}

std::string table(const std::string& caption, const std::vector<std::string>& head,
                  const std::vector<TableRow>& rows) {
  std::string out = "<div class=\"scroll\" tabindex=\"0\"><table>";
  if (!caption.empty()) out += "<caption>" + escaped(caption) + "</caption>";
  out += "<thead><tr>";
  for (const auto& cell : head) out += "<th scope=\"col\">" + cell + "</th>";
  out += "</tr></thead><tbody>\n";
  for (const TableRow& row : rows) {
    out += row.classes.empty() ? "<tr>" : "<tr class=\"" + row.classes + "\">";
    for (std::size_t i = 0; i < row.cells.size(); ++i)
      out += i == 0 ? "<th scope=\"row\">" + row.cells[i] + "</th>"
             : row.cells[i].starts_with("<span class=\"words\">")
                 ? "<td class=\"words\">" + row.cells[i] + "</td>"
                 : "<td>" + row.cells[i] + "</td>";
    out += "</tr>\n";
  }
  return out + "</tbody></table></div>\n";
}

std::string paragraph(const std::string& text) { return "<p>" + escaped(text) + "</p>\n"; }
std::string note(const std::string& text) {
  return "<p class=\"note\">" + escaped(text) + "</p>\n";
}

std::string figure(const std::vector<std::string>& drawings, const std::string& caption,
                   const std::string& classes) {
  std::string out = classes.empty() ? "<figure>" : "<figure class=\"" + classes + "\">";
  out += "<div class=\"drawings\">";
  for (const auto& d : drawings) out += d;
  out += "</div>";
  if (!caption.empty()) out += "<figcaption>" + escaped(caption) + "</figcaption>";
  return out + "</figure>\n";
}

std::string details(const std::string& summary, const std::string& html) {
  return "<details><summary>" + escaped(summary) + "</summary>\n" + html + "</details>\n";
}

}  // namespace echofuse::chart
