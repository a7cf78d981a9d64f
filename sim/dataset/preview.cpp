// SPDX-License-Identifier: MIT
#include "sim/dataset/preview.hpp"

#include <algorithm>
#include <cmath>
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

// Over range and direction, of the strongest.
void put_beams(std::ostream& out, const Axis& range, const record::Antennas& antennas,
               const record::FusedRecord& r) {
  std::vector<double> powers;
  for (std::size_t b = 0; b < range.count; ++b)
    for (std::size_t k = 0; k < record::beams; ++k)
      powers.push_back(record::beam_power(record::bin_of(r.array, antennas.size(), b), antennas,
                                          record::beam_cosine(k)));
  const double most = *std::max_element(powers.begin(), powers.end());
  constexpr double least_db = -30;
  out << "$beams << EOD\n";
  for (std::size_t i = 0; i < powers.size(); ++i) {
    const double share = most > 0 ? powers[i] / most : 0;
    out << record::beam_cosine(i % record::beams) << ' '
        << range.at(static_cast<double>(i / record::beams)) << ' '
        << (share > 0 ? std::max(least_db, 10 * std::log10(share)) : least_db) << '\n';
  }
  out << "EOD\nset title 'radar: power (dB)'; set xlabel 'sine of the azimuth'; set ylabel 'range "
         "(m)'\nset xrange [-1:1]; set colorbox; set cbrange ["
      << least_db << ":0]\nplot $beams using 1:2:3 with image notitle\n";
}

}  // namespace

void draw_record(const std::string& run_path, std::int64_t index, const std::string& png) {
  const record::RunReader run(run_path);
  const record::FusedRecord r = run.read(index);
  const auto spd = run.axis("spd"), radar = run.axis("radar");
  const auto array = run.axis("array");
  const auto antennas = run.antennas();
  const bool has_array = array && !antennas.empty() && !r.array.empty();
  std::ostringstream script;
  const auto path = std::filesystem::absolute(png);
  script << "set terminal png size " << (has_array ? 1440 : 1080) << ",330\nset output "
         << quoted(path.string()) << "\nset multiplot layout 1," << (has_array ? 4 : 3)
         << "\nset grid\n";
  put_map(script, run, r);
  if (spd && r.has(Sensor::spd))
    put_curve(script, "detector: counts", "steps lw 2", r.spd,
              [&](double i) { return spd->at(i) / ps_per_m; });
  if (radar && r.has(Sensor::radar))
    put_curve(script, "radar: " + radar->quantity, "linespoints lw 2 pt 7 ps 0.5", r.radar,
              [&](double i) { return radar->at(i); });
  if (has_array) put_beams(script, *array, antennas, r);
  script << "unset multiplot\n";
  if (!std::filesystem::is_directory(path.parent_path()))
    throw Error(ExitCode::disk, png + ": no such folder");
  run_gnuplot(script.str(), path.parent_path().string(), png + ": ");
}

}  // namespace echofuse::sim
