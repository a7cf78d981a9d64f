// SPDX-License-Identifier: MIT
// A page of HTML that needs nothing but itself: contents, sections, tables, drawings; light, dark,
// narrow and on paper.
#pragma once
#include <string>
#include <utility>
#include <vector>

namespace echofuse::chart {

class Page {
 public:
  explicit Page(std::string title) : title_(std::move(title)) {}
  // What stands before the contents; HTML, as everything that is added.
  void lead(const std::string& html) { lead_ += html; }
  // One without any html is left out.
  void section(const std::string& id, const std::string& heading, const std::string& html);
  std::string html() const;

 private:
  struct Section {
    std::string id, heading, html;
  };
  std::string title_, lead_;
  std::vector<Section> sections_;
};

struct TableRow {
  std::vector<std::string> cells;  // HTML; the first is the row's head
  std::string classes = {};        // "baseline", "best"
};
// Scrolls by itself where the page is too narrow, its first column stays. `caption` may be empty.
std::string table(const std::string& caption, const std::vector<std::string>& head,
                  const std::vector<TableRow>& rows);
std::string paragraph(const std::string& text);  // of plain text
// Drawings (chart.hpp, picture.hpp) side by side as far as there is room; the caption is plain
// text.
std::string figure(const std::vector<std::string>& drawings, const std::string& caption,
                   const std::string& classes = {});

}  // namespace echofuse::chart
