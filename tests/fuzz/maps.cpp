// SPDX-License-Identifier: MIT
// Input: a folder of maps in the format of files.hpp. The folder has the bytes of maps.npy (m) or a
// recipe for it (M), records.csv (c), camera.json (j), run.txt (t), a PNG (p), the filtered rows of
// another PNG (P), compressed data (z) and a table of scores (s).
#include "acquire/record/deflate.hpp"
#include "files.hpp"
#include "recon/maps/png.hpp"
#include "recon/maps/written_maps.hpp"
#include "recon/score/paired.hpp"

namespace {

constexpr std::uint32_t side = 4;

// Returns a PNG that contains the filtered rows `rows`, truncated or padded with zeros to the image
// size.
Bytes png_of(ByteView rows) {
  constexpr std::size_t to_data = 33, row_bytes = 2 * side + 1;
  const Bytes blank = recon::encode_png16(std::vector<std::uint16_t>(side * side), side, side);
  Bytes whole(rows.begin(),
              rows.begin() + std::min<std::ptrdiff_t>(std::ssize(rows), side * row_bytes));
  whole.resize(side * row_bytes);
  const Bytes packed = record::deflated(whole, 1);
  Bytes out(blank.begin(), blank.begin() + to_data);
  out.insert(out.end(), {0, 0, 0, static_cast<std::uint8_t>(packed.size()), 'I', 'D', 'A', 'T'});
  out.insert(out.end(), packed.begin(), packed.end());
  // The CRC may be zero, because the compressed rows have a checksum of their own.
  out.insert(out.end(), 4, 0);
  out.insert(out.end(), blank.end() - 12, blank.end());
  return out;
}

void check_inflated(ByteView data) {
  for (const std::size_t count : {0ul, 1ul, 7ul, 64ul, 4096ul}) {
    const Bytes out = record::inflated(data, count);
    require(out.empty() || out.size() == count, "all values or none");
    const auto wide = record::inflated<std::uint16_t>(data, count);
    require(wide.empty() || wide.size() == count, "all values or none");
  }
  const Bytes packed = record::deflated(data, 1);
  require(std::ranges::equal(record::inflated(packed, data.size()), data), "deflate is undone");
}

void check_maps(const std::string& folder) {
  const recon::WrittenMaps maps = recon::read_written_maps(folder, {.size = side});
  require(!maps.of_index.empty(), "a folder of maps has a map");
  for (const auto& [index, map] : maps.of_index) {
    require(map.size() == side * side, "a map has the grid's size");
    require(std::ranges::all_of(map, [](float z) { return z >= -100 && z < 1e6f; }),
            "depths are finite");
  }
}

}  // namespace

void fuzz::run(ByteView input) {
  static const Folder folder;
  const auto files = files_of(input);
  write_files(folder, files,
              {{'m', "maps.npy"},
               {'c', "records.csv"},
               {'j', "camera.json"},
               {'t', "run.txt"},
               {'p', "000003_mm.png"},
               {'s', "scores.csv"}});
  if (files.contains('M')) folder.write("maps.npy", npy_of(files.at('M')));
  if (files.contains('P')) folder.write("000001.png", png_of(files.at('P')));
  if (files.contains('z')) check_inflated(files.at('z'));
  refused_or_done({ExitCode::failed}, [] { check_maps(folder.path()); });
  if (!files.contains('s')) return;
  refused_or_done({ExitCode::failed}, [] {
    for (const recon::NamedScores& named : recon::read_scores(folder / "scores.csv"))
      require(!named.of_record.empty(), "a name has scores");
  });
}
