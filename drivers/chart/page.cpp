// SPDX-License-Identifier: MIT
#include "drivers/chart/page.hpp"

#include "drivers/chart/style.hpp"

namespace echofuse::chart {
namespace {

constexpr const char* page_style = R"css(*{box-sizing:border-box}
body{margin:0 auto;padding:16px 20px 48px;max-width:1240px;background:var(--back);color:var(--ink);
font:16px/1.45 system-ui,"DejaVu Sans",sans-serif;font-variant-numeric:tabular-nums}
h1{font-size:24px;line-height:1.2;margin:0 0 4px}h2{font-size:20px;margin:40px 0 8px;padding-top:8px;border-top:2px solid var(--edge)}
h3{font-size:16px;margin:20px 0 4px}p{max-width:78ch;margin:8px 0;overflow-wrap:anywhere}
a{color:var(--c0)}:focus-visible{outline:3px solid var(--c0);outline-offset:2px}
.quiet,figcaption,.caption{color:var(--quiet);fill:var(--quiet)}
h2 a{color:inherit;text-decoration:none}h2 a:hover{text-decoration:underline}
nav{margin:12px 0}nav ol{display:flex;flex-wrap:wrap;gap:4px 22px;list-style-position:inside;margin:0;padding:0;color:var(--quiet)}
.scroll{overflow-x:auto;margin:12px 0;max-width:max-content;background:linear-gradient(90deg,var(--paper) 30%,transparent) 0 0/40px 100% no-repeat local,
linear-gradient(-90deg,var(--paper) 30%,transparent) 100% 0/40px 100% no-repeat local,
linear-gradient(-90deg,var(--edge),transparent) 100% 0/16px 100% no-repeat scroll,var(--paper)}
table{border-collapse:collapse;font-size:15px}
.caption{margin:14px 0 -8px;font-size:14px;max-width:96ch}
th,td{padding:5px 12px;border-bottom:1px solid var(--grid);text-align:right;vertical-align:top}
thead th{vertical-align:bottom;border-bottom:2px solid var(--edge);font-weight:600;line-height:1.25}
th:first-child,td:first-child,th.words{text-align:left}th:first-child{position:sticky;left:0;background:var(--paper);min-width:8.5em;max-width:24em}tbody th{font-weight:600}td small,th small{color:var(--quiet);font-weight:400}
tr.baseline th{font-weight:400}tr.baseline>*{color:var(--quiet)}
td b.best{color:var(--good)}td b.best::after{content:" best";font-size:12px;font-weight:600}
td.words{text-align:left}td small{white-space:nowrap}
.narrow-only{display:none}
.good{color:var(--good)}.look{color:var(--look)}.bad{color:var(--bad)}
figure{margin:14px 0;padding:12px;background:var(--paper);border:1px solid var(--grid);border-radius:8px}
.drawings{display:flex;flex-wrap:wrap;gap:12px 20px;align-items:flex-start}
.drawings>svg{max-width:100%;height:auto;flex:0 1 auto}
figcaption{margin-top:8px;font-size:14px;max-width:90ch}
pre{white-space:pre-wrap;overflow-wrap:anywhere;background:var(--paper);border:1px solid var(--grid);border-radius:6px;padding:8px 12px;font-size:14px}
dl{display:grid;grid-template-columns:max-content minmax(0,1fr);gap:4px 16px;margin:12px 0}dt{color:var(--quiet)}dd{margin:0;overflow-wrap:anywhere}
@media (max-width:640px){body{padding:12px 12px 32px}dl{grid-template-columns:minmax(0,1fr)}dd{margin-bottom:6px}
th,td{padding:5px 8px}table{font-size:14px}figure{padding:8px}th:first-child{max-width:11em}
.wide-only{display:none}.narrow-only{display:block}.scroll{max-width:100%}}
@page{size:A4;margin:12mm 11mm 15mm;@bottom-right{content:counter(page) " / " counter(pages);font:9pt sans-serif}}
@media print{body{max-width:none;background:#fff;padding:0;font-size:10.5pt}.screen,h2 a{display:none}
h1{font-size:16pt}h2{font-size:13pt}
h2{margin-top:18px}h2,h3,.caption,thead{break-after:avoid}tr,svg{break-inside:avoid}
.scroll{overflow:visible;max-width:none;background:none}table{font-size:8.5pt}th,td{padding:2px 5px}
td small,th small{white-space:normal}figure{padding:6px}.drawings{gap:8px}.drawings>svg{max-width:32%}
.drawings>svg.narrow-only{max-width:48%}.wide-only{display:none}.wide-only+.narrow-only{display:block}}
)css";

}  // namespace

void Page::section(const std::string& id, const std::string& heading, const std::string& html) {
  if (!html.empty()) sections_.push_back({id, heading, html});
}

std::string Page::html() const {
  std::string out =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width,initial-scale=1\"><title>" +
      escaped(title_) + "</title><style>\n" + page_colours() + page_style + drawing_style(true) +
      "</style></head><body>\n<header id=\"top\"><h1>" + escaped(title_) + "</h1>\n" + lead_ +
      "</header>\n";
  std::string contents;
  for (const Section& s : sections_)
    contents += "<li><a href=\"#" + s.id + "\">" + escaped(s.heading) + "</a></li>";
  if (sections_.size() > 1) out += "<nav aria-label=\"Contents\"><ol>" + contents + "</ol></nav>\n";
  out += "<main>\n";
  std::size_t n = 0;
  for (const Section& s : sections_)
    out += "<section aria-labelledby=\"" + s.id + "\"><h2 id=\"" + s.id + "\">" +
           std::to_string(++n) + ". " + escaped(s.heading) +
           " <a href=\"#top\" aria-label=\"to the contents\">\u2191</a></h2>\n" + s.html +
           "</section>\n";
  out += "</main>\n";
  return out + "</body></html>\n";
}

std::string table(const std::string& caption, const std::vector<std::string>& head,
                  const std::vector<TableRow>& rows) {
  // Not a <caption>: it would scroll away with its table.
  std::string out;
  if (!caption.empty()) out += "<p class=\"caption\">" + escaped(caption) + "</p>";
  out += "<div class=\"scroll\" tabindex=\"0\"><table";
  out += caption.empty() ? ">" : " aria-label=\"" + escaped(caption) + "\">";
  out += "<thead><tr>";
  for (std::size_t i = 0; i < head.size(); ++i) {
    const bool words = !rows.empty() && i < rows.front().cells.size() &&
                       rows.front().cells[i].starts_with("<span class=\"words\">");
    out +=
        std::string("<th scope=\"col\"") + (words ? " class=\"words\">" : ">") + head[i] + "</th>";
  }
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
std::string figure(const std::vector<std::string>& drawings, const std::string& caption,
                   const std::string& classes) {
  std::string out = classes.empty() ? "<figure>" : "<figure class=\"" + classes + "\">";
  out += "<div class=\"drawings\">";
  for (const auto& d : drawings) out += d;
  out += "</div>";
  if (!caption.empty()) out += "<figcaption>" + escaped(caption) + "</figcaption>";
  return out + "</figure>\n";
}

}  // namespace echofuse::chart
