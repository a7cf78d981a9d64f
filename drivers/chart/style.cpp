// SPDX-License-Identifier: MIT
#include "drivers/chart/style.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "drivers/program/printable.hpp"

namespace echofuse::chart {
namespace {

struct Colour {
  const char *name, *light, *dark;
};
constexpr std::array colours{
    Colour{"c0", "#0f56c9", "#7093f4"},         Colour{"c1", "#a34d00", "#ee974c"},
    Colour{"c2", "#006b45", "#01e9a3"},         Colour{"c3", "#16191d", "#ffffff"},
    Colour{"c4", "#5b0f75", "#f4d006"},         Colour{"c5", "#50565c", "#818890"},
    Colour{"paper", "#ffffff", "#191d21"},      Colour{"ink", "#16191d", "#eceff2"},
    Colour{"quiet", "#4a5058", "#b3bac2"},      Colour{"grid", "#dfe2e6", "#343a41"},
    Colour{"edge", "#8a9098", "#767d85"},       Colour{"back", "#f4f5f7", "#101316"},
    Colour{"good", "#136f2f", "#62d984"},       Colour{"look", "#7a4b00", "#ffc24d"},
    Colour{"bad", "#b3201a", "#ff8d85"},        Colour{"good-paper", "#e2f3e6", "#12301b"},
    Colour{"look-paper", "#fdf0d2", "#372806"}, Colour{"bad-paper", "#fbe1df", "#471512"}};

std::string value_of(const std::string& name, bool variables) {
  if (variables) return "var(--" + name + ")";
  for (const Colour& c : colours)
    if (name == c.name) return c.light;
  return "#000";
}

}  // namespace

double text_width(std::string_view text, double px) {
  double em = 0;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte & 0xc0) == 0x80) continue;  // of a character that began before
    if (std::string_view("iljtfr.,:;'|!()[] ").find(c) != std::string_view::npos)
      em += 0.35;
    else if (std::string_view("mwMW@%").find(c) != std::string_view::npos)
      em += 0.9;
    else
      em += c >= 'A' && c <= 'Z' ? 0.69 : 0.6;
  }
  return em * px;
}

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : printable(std::string(text))) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else
      out += c;
  }
  return out;
}

std::vector<std::string> wrapped(const std::string& text, double width_px) {
  std::vector<std::string> lines(1);
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    std::string& line = lines.back();
    if (line.empty())
      line = word;
    else if (text_width(line + ' ' + word) <= width_px)
      line += ' ' + word;
    else
      lines.push_back(word);
  }
  return lines;
}

std::string base64(ByteView bytes) {
  constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t n = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t block = 0;
    for (std::size_t k = 0; k < 3; ++k) block = block << 8 | (k < n ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= n ? digits[block >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

std::string data_uri(const char* type, ByteView bytes) {
  return std::string("data:") + type + ";base64," + base64(bytes);
}

std::string number(double value) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.2f", value);
  std::string out = text.data();
  while (out.back() == '0') out.pop_back();
  if (out.back() == '.') out.pop_back();
  return out == "-0" ? "0" : out;
}

std::string drawing_style(bool variables) {
  const auto colour = [&](const std::string& name) { return value_of(name, variables); };
  std::string out;
  for (int i = 0; i < colour_count; ++i) {
    const std::string n = std::to_string(i), c = colour("c" + n);
    out += ".s" + n + "{stroke:" + c + ";fill:none}.f" + n + "{fill:" + c + "}\n";
  }
  out +=
      ".drawing{font:13px system-ui,\"DejaVu "
      "Sans\",sans-serif;font-variant-numeric:tabular-nums}\n";
  out += ".drawing text{fill:" + colour("ink") + "}.drawing text.title{font-weight:600}\n";
  out += ".drawing text.quiet{fill:" + colour("quiet") + "}.drawing text.big{font-size:16px}\n";
  for (int i = 0; i < colour_count; ++i)
    out += ".drawing text.f" + std::to_string(i) + "{fill:" + colour("c" + std::to_string(i)) + "}";
  out += "\n.halo{paint-order:stroke;stroke:" + colour("paper") +
         ";stroke-width:3px;stroke-linejoin:round}\n";
  out += ".paper{fill:" + colour("paper") + "}.grid{stroke:" + colour("grid") +
         "}.edge{stroke:" + colour("edge") + ";fill:none}.void{fill:" + colour("grid") + "}\n";
  out +=
      ".l{stroke-width:2;stroke-linejoin:round}.e{stroke-width:1.2}.dash{stroke-dasharray:6 4}\n";
  out += ".lead{stroke-width:1;opacity:.6}.area{opacity:.18;stroke:none}\n";
  // Over pictures, whose ground is light in the dark too.
  out += ".outline{stroke:#3c4148;stroke-width:1;fill:none}\n";
  for (const char* name : {"good", "look", "bad"})
    out += std::string(".") + name + "{fill:" + colour(name) + "}";
  return out + "\nimage{image-rendering:pixelated}\n";
}

std::string page_colours() {
  std::string light, dark;
  for (const Colour& c : colours) {
    light += std::string("--") + c.name + ":" + c.light + ";";
    dark += std::string("--") + c.name + ":" + c.dark + ";";
  }
  return ":root{color-scheme:light dark;" + light +
         "}\n@media screen and (prefers-color-scheme:dark){:root{" + dark + "}}\n";
}

}  // namespace echofuse::chart
