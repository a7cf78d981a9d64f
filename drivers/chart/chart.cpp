// SPDX-License-Identifier: MIT
#include "drivers/chart/chart.hpp"

#include <algorithm>
#include <array>

#include "drivers/chart/labels.hpp"
#include "drivers/chart/style.hpp"

namespace echofuse::chart {
namespace {

constexpr double line_px = 16, gap = 8;

bool shows(const Scale& scale, double value) {
  return std::isfinite(value) && (!scale.log || value > 0);
}

// Data to pixels.
struct Mapping {
  double first = 0, last = 1, at_first = 0, at_last = 1;
  bool log = false;
  double operator()(double value) const {
    const double share =
        log ? std::log(value / first) / std::log(last / first) : (value - first) / (last - first);
    return at_first + share * (at_last - at_first);
  }
  bool within(double value) const {
    const double slack = log ? 0 : 1e-9 * (last - first);
    return value >= first * (log ? 1 - 1e-9 : 1) - slack &&
           value <= last * (log ? 1 + 1e-9 : 1) + slack;
  }
};

// "s3" of 's' and 3.
std::string classed(char kind, int colour) {
  std::string out(1, kind);
  return out += std::to_string(colour);
}

std::string attributes(std::initializer_list<std::pair<const char*, double>> values) {
  std::string out;
  for (const auto& [name, value] : values)
    out += std::string(" ") + name + "=\"" + number(value) + "\"";
  return out;
}

std::string line(const std::string& classes, double x1, double y1, double x2, double y2) {
  return "<line class=\"" + classes + "\"" +
         attributes({{"x1", x1}, {"y1", y1}, {"x2", x2}, {"y2", y2}}) + "/>";
}

std::string text(const std::string& classes, double x, double y, const std::string& words,
                 const char* anchor = "start") {
  return "<text class=\"" + classes + "\"" + attributes({{"x", x}, {"y", y}}) +
         (std::string(anchor) == "start" ? "" : std::string(" text-anchor=\"") + anchor + "\"") +
         ">" + escaped(words) + "</text>";
}

// Of each colour its own shape, about (x, y).
std::string marker(int colour, double x, double y, double r) {
  const std::string fill = " class=\"" + classed('f', colour) + "\"";
  const auto shape = [&](std::initializer_list<std::array<double, 2>> corners) {
    std::string points;
    for (const auto& c : corners) points += number(x + r * c[0]) + "," + number(y + r * c[1]) + " ";
    points.pop_back();
    return "<polygon" + fill + " points=\"" + points + "\"/>";
  };
  switch (colour) {
    case 1:
      return shape({{-.9, -.9}, {.9, -.9}, {.9, .9}, {-.9, .9}});
    case 2:
      return shape({{0, -1.2}, {1.15, .85}, {-1.15, .85}});
    case 3:
      return shape({{0, -1.3}, {1.3, 0}, {0, 1.3}, {-1.3, 0}});
    case 4:
      return shape({{0, 1.2}, {1.15, -.85}, {-1.15, -.85}});
    default:
      return "<circle" + fill + attributes({{"cx", x}, {"cy", y}, {"r", r}}) + "/>";
  }
}

class Plot {
 public:
  explicit Plot(const Panel& panel)
      : p_(panel),
        title_(panel.title.empty() ? Lines{} : wrapped(panel.title, panel.width - 8)),
        notes_(panel.note.empty() ? Lines{} : wrapped(panel.note, panel.width - 8)) {
    span(p_.x, x_, true);
    span(p_.y, y_, false);
    lay_out();
  }

  Drawing drawing() { return {svg(), p_.width, height()}; }

 private:
  double height() const { return p_.height + slant_px_; }  // the axes stay as high as they were
  std::string svg() {
    for (const Series& s : p_.series) keep_clear_of(s);
    draw_frame();
    for (const Rule& r : p_.rules) draw(r);
    for (const Series& s : p_.series) draw(s);
    name_series();
    return "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"drawing\" role=\"img\" viewBox=\"0 "
           "0 " +
           number(p_.width) + " " + number(height()) + "\"" +
           attributes({{"width", p_.width}, {"height", height()}}) + "><title>" +
           escaped(spoken()) + "</title>" + out_ + "</svg>";
  }

  using Lines = std::vector<std::string>;
  std::string spoken() const {
    return (p_.title.empty() ? "" : p_.title + ": ") + p_.y.title + " against " + p_.x.title;
  }

  void span(const Scale& scale, Mapping& map, bool across) {
    double low = INFINITY, high = -INFINITY;
    const auto take = [&](double v) {
      if (shows(scale, v)) low = std::min(low, v), high = std::max(high, v);
    };
    for (const Series& s : p_.series)
      for (const Point& point : s.points) {
        take(across ? point.x : point.y);
        if (!across) take(point.low), take(point.high);
      }
    for (const Rule& r : p_.rules)
      if (r.vertical == across) take(r.at);
    for (const auto& tick : scale.ticks) take(tick.first);
    if (!(low <= high)) low = scale.log ? 1 : 0, high = scale.log ? 10 : 1;
    map.log = scale.log;
    if (scale.log) {
      const double room = std::pow(std::max(high / low, 1.5), 0.05);
      low /= room, high *= room;
    } else {
      const double room = high > low ? 0.05 * (high - low) : std::max(1e-9, std::abs(high) * 0.1);
      low -= room, high += room;
    }
    map.first = std::isnan(scale.first) ? low : scale.first;
    map.last = std::isnan(scale.last) ? high : scale.last;
  }

  std::vector<std::pair<double, std::string>> ticks(const Scale& scale, const Mapping& map,
                                                    double length) const {
    if (!scale.ticks.empty()) return scale.ticks;
    std::vector<std::pair<double, std::string>> out;
    const auto values = round_ticks(map.first, map.last, map.log, length);
    for (const double v : values)
      out.emplace_back(v, short_number(v, map.log ? 0 : std::abs(values.back())));
    if (map.log && map.last < 1e3 * map.first)  // lines without names between
      for (double d = std::pow(10, std::floor(std::log10(map.first))); d < map.last; d *= 10)
        for (int k = 2; k < 10; ++k) out.emplace_back(k * d, "");
    return out;
  }

  bool named_at_end(const Series& s) const { return !s.name.empty() && !s.points.empty(); }

  void lay_out() {
    double widest = 0, right = 14;
    const double about = 1.4 * (p_.height - 80);
    for (const auto& [at, name] : ticks(p_.y, y_, about))
      widest = std::max(widest, text_width(name));
    for (const Series& s : p_.series)
      if (named_at_end(s)) right = std::max(right, text_width(s.name) + 18), names_right_ = true;
    for (const Rule& r : p_.rules)
      if (names_right_ && !r.vertical) right = std::max(right, text_width(r.name) + 18);
    box_ = {widest + 34, title_.empty() ? 12 : 16 + line_px * static_cast<double>(title_.size()),
            p_.width - std::min(right, p_.width * 0.42),
            p_.height - 42 - line_px * static_cast<double>(notes_.size())};
    x_.at_first = box_.left, x_.at_last = box_.right;
    if (words_meet())
      for (const auto& tick : p_.x.ticks)
        slant_px_ = std::max(slant_px_, std::sin(35 * M_PI / 180) * text_width(tick.second));
    y_.at_first = box_.bottom, y_.at_last = box_.top;
  }

  // Numbers between others may be left out; words may not.
  bool words_meet() const {
    double after = -1e9;
    for (const auto& [at, name] : p_.x.ticks) {
      if (name.empty()) continue;
      const double half = text_width(name) / 2;
      if (x_(at) - half < after && name.find_first_of("0123456789") != 0) return true;
      after = x_(at) + half + 6;
    }
    return false;
  }

  void draw_frame() {
    for (std::size_t i = 0; i < title_.size(); ++i)
      out_ += text("title", 4, 17 + line_px * static_cast<double>(i), title_[i]);
    double after = -1e9;
    for (const auto& [at, name] : ticks(p_.x, x_, box_.right - box_.left)) {
      if (!x_.within(at)) continue;
      const double x = x_(at), half = text_width(name) / 2;
      out_ += line("grid", x, box_.top, x, box_.bottom);
      if (name.empty() || (slant_px_ == 0 && x - half < after)) continue;
      if (slant_px_ > 0)
        out_ += "<text class=\"tick\" text-anchor=\"end\" transform=\"translate(" + number(x + 4) +
                " " + number(box_.bottom + 14) + ") rotate(-35)\">" + escaped(name) + "</text>";
      else
        out_ += text("tick", x, box_.bottom + 17, name, "middle");
      after = x + half + 6;
    }
    double above = 1e9;
    for (const auto& [at, name] : ticks(p_.y, y_, 1.4 * (box_.bottom - box_.top))) {
      if (!y_.within(at)) continue;
      const double y = y_(at);
      out_ += line("grid", box_.left, y, box_.right, y);
      if (name.empty() || std::abs(y - above) < 13) continue;
      out_ += text("tick", box_.left - 7, y + 4.5, name, "end");
      above = y;
    }
    out_ += "<rect class=\"edge\"" +
            attributes({{"x", box_.left},
                        {"y", box_.top},
                        {"width", box_.right - box_.left},
                        {"height", box_.bottom - box_.top}}) +
            "/>";
    const double middle = (box_.top + box_.bottom) / 2;
    out_ += text("quiet", (box_.left + box_.right) / 2, box_.bottom + 35 + slant_px_, p_.x.title,
                 "middle");
    out_ += "<text class=\"quiet\" text-anchor=\"middle\" transform=\"translate(14 " +
            number(middle) + ") rotate(-90)\">" + escaped(p_.y.title) + "</text>";
    for (std::size_t i = 0; i < notes_.size(); ++i)
      out_ += text("quiet", 4, height() - 5 - line_px * static_cast<double>(notes_.size() - 1 - i),
                   notes_[i]);
  }

  void draw(const Rule& r) {
    const Mapping& map = r.vertical ? x_ : y_;
    if (!map.within(r.at)) return;
    const double at = map(r.at), width = text_width(r.name);
    out_ += r.vertical ? line("edge dash", at, box_.top, at, box_.bottom)
                       : line("edge dash", box_.left, at, box_.right, at);
    if (r.name.empty() || (names_right_ && !r.vertical)) return;
    const bool left = at + width + 8 > box_.right;
    double x = r.vertical ? (left ? at - width - 5 : at + 5) : box_.left + 6;
    const double y = r.vertical ? box_.top + 14 : at - 5 < box_.top + 12 ? at + 14 : at - 5;
    const auto over = [&] {  // something that is drawn
      const Box own{x, y - 11, x + width, y + 3};
      return std::any_of(taken_.begin(), taken_.end(), [&](const Box& b) { return own.meets(b); });
    };
    if (!r.vertical)
      while (over() && x + width + 24 < box_.right) x += 12;
    out_ += text("quiet halo", x, y, r.name);
    taken_.push_back({x, y - 11, x + width, y + 3});
  }

  struct Spot {
    double x, y;
  };
  bool spot(const Point& point, Spot& at) const {
    if (!shows(p_.x, point.x) || !shows(p_.y, point.y) || !x_.within(point.x)) return false;
    at = {x_(point.x), std::clamp(y_(point.y), box_.top, box_.bottom)};
    return true;
  }

  void keep_clear_of(const Series& s) {
    Spot at{}, before{};
    bool pen = false;
    const bool markers = s.look == Look::both || s.look == Look::markers;
    const bool lines = s.look == Look::both || s.look == Look::line;
    for (const Point& point : s.points) {
      const bool shown = spot(point, at);
      if (shown && markers) taken_.push_back({at.x - 5, at.y - 5, at.x + 5, at.y + 5});
      if (shown && lines && pen) {
        const double steps = std::min(std::hypot(at.x - before.x, at.y - before.y) / 6, 60.0);
        for (double k = 1; k < steps; ++k) {
          const double x = before.x + (at.x - before.x) * k / steps;
          const double y = before.y + (at.y - before.y) * k / steps;
          taken_.push_back({x - 1, y - 1, x + 1, y + 1});
        }
      }
      pen = shown, before = at;
    }
  }

  void draw_line(const Series& s) {
    std::string path;
    bool pen = false;
    double before = 0;
    for (const Point& point : s.points) {
      Spot at{};
      if (!spot(point, at)) {
        pen = false;
        continue;
      }
      if (pen && s.look == Look::steps) path += "L" + number(at.x) + " " + number(before);
      path += (pen ? "L" : "M") + number(at.x) + " " + number(at.y);
      pen = true, before = at.y;
    }
    if (!path.empty())
      out_ += "<path class=\"l " + classed('s', s.colour) + (s.dashed ? " dash" : "") + "\" d=\"" +
              path + "\"/>";
  }

  void draw(const Series& s) {
    if (s.look != Look::markers) draw_line(s);
    const std::string stroke = classed('s', s.colour);
    for (const Point& point : s.points) {
      Spot at{};
      if (!spot(point, at)) continue;
      if (shows(p_.y, point.low) && shows(p_.y, point.high)) {
        const double top = std::clamp(y_(point.high), box_.top, box_.bottom);
        const double bottom = std::clamp(y_(point.low), box_.top, box_.bottom);
        out_ += line("e " + stroke, at.x, top, at.x, bottom);
        for (const double end : {top, bottom})
          out_ += line("e " + stroke, at.x - 3, end, at.x + 3, end);
      }
      if (s.look == Look::both || s.look == Look::markers)
        out_ += marker(s.colour, at.x, at.y, 3.6);
      if (point.crossed)
        for (const double up : {-7.0, 7.0})
          out_ += line("l " + stroke, at.x - 7, at.y - up, at.x + 7, at.y + up);
    }
    for (const Point& point : s.points) {
      Spot at{};
      if (point.label.empty() || !spot(point, at)) continue;
      const double width = text_width(point.label);
      const Place place = place_label(at.x, at.y, width, box_, taken_);
      if (place.far)
        out_ += line("lead " + stroke, at.x, at.y, std::clamp(at.x, place.x, place.x + width),
                     place.y - 4);
      out_ += text("halo " + classed('f', s.colour), place.x, place.y, point.label);
    }
  }

  // At the right edge, each at the height of its last point.
  void name_series() {
    struct Name {
      std::string text, kind;
      Spot at;
    };
    std::vector<double> wanted;
    std::vector<Name> named;
    for (const Series& s : p_.series) {
      Spot at{}, last{};
      bool any = false;
      if (named_at_end(s))
        for (const Point& point : s.points)
          if (spot(point, at)) last = at, any = true;
      if (any) named.push_back({s.name, std::to_string(s.colour), last});
    }
    for (const Rule& r : p_.rules)
      if (names_right_ && !r.vertical && !r.name.empty() && y_.within(r.at))
        named.push_back({r.name, std::to_string(grey), {box_.right - 4, y_(r.at)}});
    for (const Name& n : named) wanted.push_back(n.at.y);
    const auto places = spread_apart(wanted, line_px, box_.top + 4, box_.bottom - 2);
    for (std::size_t i = 0; i < named.size(); ++i) {
      const auto& [name, colour, at] = named[i];
      out_ += line("lead s" + colour, at.x + 4, at.y, box_.right + gap - 1, places[i]);
      out_ += text("f" + colour, box_.right + gap + 2, places[i] + 4.5, name);
    }
  }

  const Panel& p_;
  Lines title_, notes_;
  Mapping x_, y_;
  Box box_{};
  double slant_px_ = 0;  // height of names of x that would meet, and are slanted
  bool names_right_ = false;
  std::vector<Box> taken_;
  std::string out_;
};

}  // namespace

Drawing draw(const Panel& panel) { return Plot(panel).drawing(); }

}  // namespace echofuse::chart
