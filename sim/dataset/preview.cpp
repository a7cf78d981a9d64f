// SPDX-License-Identifier: MIT
#include "sim/dataset/preview.hpp"

#include <algorithm>
#include <filesystem>
#include <sstream>

#include "acquire/record/run_file.hpp"
#include "drivers/chart/gnuplot.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/printable.hpp"

namespace echofuse::sim {
namespace {

// In gnuplot's single quotes, which end with the line: what follows it would be a command.
std::string quoted(const std::string& text) {
  std::string all = "'";
  for (const char c : printable(text)) all += c == '\'' ? "''" : std::string(1, c);
  return all + "'";
}

void put_map(std::ostream& out, const record::RunReader& run, const record::FusedRecord& r) {
  const auto x = run.axis("depth_x"), y = run.axis("depth_y");
  if (!r.has(Sensor::depth) || !x || !y) {
    out << "set title 'no depth'; unset colorbox; plot NaN notitle\n";
    return;
  }
  out << "$map << EOD\n";
  for (std::uint32_t iy = 0; iy < y->count; ++iy)
    for (std::uint32_t ix = 0; ix < x->count; ++ix)
      out << x->at(ix) << ' ' << y->at(iy) << ' '
          << r.depth_mm[std::size_t{iy} * x->count + ix] / 1000.0 << '\n';
  const auto half = [](const Axis& a) { return a.step * a.count / 2; };
  out << "EOD\nset title " << quoted(r.label + ", depth (m)") << " noenhanced\n"
      << "set size ratio -1; set xtics 0.25; set ytics 0.25; set xlabel 'x / z'; set ylabel 'y / "
         "z'\n"
      << "set xrange [" << -std::abs(half(*x)) << ':' << std::abs(half(*x)) << "]\n"
      << "set yrange [" << -std::abs(half(*y)) << ':' << std::abs(half(*y)) << "]\n"
      << "set cbrange [0:*]\nset palette defined (0 '#440154', 1 '#3b528b', 2 '#21918c', 3 "
         "'#5ec962', 4 '#fde725')\nplot $map using 1:2:3 with image notitle\n"
      << "unset colorbox; set size noratio; set autoscale; unset ylabel\n"
      << "set xtics autofreq; set ytics autofreq\n";
}

template <class Values, class Place>
void put_curve(std::ostream& out, const std::string& title, const char* style, const Values& values,
               Place place) {
  out << "$curve << EOD\n";
  for (std::size_t i = 0; i < values.size(); ++i)
    out << place(static_cast<double>(i)) << ' ' << values[i] << '\n';
  out << "EOD\nset title " << quoted(title)
      << "; set xlabel 'range (m)'\nplot $curve using 1:2 with " << style << " notitle\n";
}

}  // namespace

void draw_record(const std::string& run_path, std::int64_t index, const std::string& png) {
  const record::RunReader run(run_path);
  const record::FusedRecord r = run.read(index);
  const auto spd = run.axis("spd"), radar = run.axis("radar");
  std::ostringstream script;
  const auto path = std::filesystem::absolute(png);
  script << "set terminal png size 1080,330\nset output " << quoted(path.string())
         << "\nset multiplot layout 1,3\nset grid\n";
  put_map(script, run, r);
  if (spd && r.has(Sensor::spd))
    put_curve(script, "detector: counts", "steps lw 2", r.spd,
              [&](double i) { return spd->at(i) / ps_per_m; });
  if (radar && r.has(Sensor::radar))
    put_curve(script, "radar: " + radar->quantity, "linespoints lw 2 pt 7 ps 0.5", r.radar,
              [&](double i) { return radar->at(i); });
  script << "unset multiplot\n";
  if (!std::filesystem::is_directory(path.parent_path()))
    throw Error(ExitCode::disk, png + ": no such folder");
  run_gnuplot(script.str(), path.parent_path().string(), png + ": ");
}

}  // namespace echofuse::sim
