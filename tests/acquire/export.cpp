// SPDX-License-Identifier: MIT
#include "acquire/record/export.hpp"

#include <cmath>
#include <sstream>

#include "acquire/record/h5.hpp"
#include "testing.hpp"

using namespace echofuse;
using namespace echofuse::record;
using namespace testing;

TEST_CASE("what is exported to HDF5 is the run") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  {
    RunWriter run(path, {});
    for (const auto& axis : small_axes()) run.put_axis(axis);
    run.put_device({Sensor::spd, "bridge:tcp://h:1", "TT", "42", "1.0", {}});
    for (std::int64_t i = 0; i < 20; ++i) {
      auto r = small_record(i);
      if (i == 7) r.valid = 0;
      if (i == 9) r.radar[1] = std::nanf("");
      run.append(r);
    }
    run.close("complete");
  }
  const RunReader run(path);
  CHECK(export_h5(run, folder / "a.h5") == 1);

  const H5File in = H5File::open(folder / "a.h5");
  const std::string data = "/entry/data/";
  CHECK(in.shape(data + "spd") == H5Shape{20, 8});
  CHECK(in.shape(data + "radar") == H5Shape{20, 4});
  CHECK(in.shape(data + "depth") == H5Shape{20, 2, 3});
  const auto spd = in.read<std::uint32_t>(data + "spd");
  const auto radar = in.read<float>(data + "radar");
  const auto depth = in.read<std::uint16_t>(data + "depth");
  const auto valid = in.read<std::uint8_t>(data + "valid");
  const auto index = in.read<std::int64_t>(data + "index");
  const auto start = in.read<std::int64_t>(data + "slot_start");
  const auto label = in.read_texts(data + "label");
  for (std::size_t i = 0; i < 20; ++i) {
    const auto r = small_record(static_cast<std::int64_t>(i));
    REQUIRE(index[i] == r.index);
    const bool bad = i == 7 || i == 9;
    REQUIRE(valid[i] == (bad ? 0 : 7));
    for (std::size_t b = 0; b < 8; ++b) REQUIRE(spd[i * 8 + b] == (bad ? 0 : r.spd[b]));
    for (std::size_t p = 0; p < 6; ++p) REQUIRE(depth[i * 6 + p] == (bad ? 0 : r.depth_mm[p]));
    if (bad)
      REQUIRE(std::isnan(radar[i * 4 + 3]));
    else
      REQUIRE(radar[i * 4 + 3] == r.radar[3]);
    if (i != 9) REQUIRE(label[i] == r.label);
    if (i != 9) REQUIRE(start[i] == r.slot_start.count());
  }
  CHECK(in.read_texts("/entry/sync/radar/verdict")[9] ==
        "unreadable: radar bin 1 is not a finite number");
  CHECK(in.read<double>(data + "spd_time")[3] == 13343 + 300);
  CHECK(in.get<std::string>(data + "spd_time", "units") == "ps");
  CHECK(in.get<std::string>(data + "depth", "units") == "mm");
  CHECK(in.get<std::string>("/entry", "NX_class") == "NXentry");
  CHECK(in.read_text("/entry/entry_identifier") == run.info().uuid);
  CHECK(in.read_text("/entry/instrument/spd/model") == "TT");
}

TEST_CASE("an export never overwrites, and leaves nothing behind if it fails") {
  const Folder folder;
  write_run(folder / "a.sqlite", 2);
  const RunReader run(folder / "a.sqlite");
  write_file(folder / "a.h5", "precious");
  CHECK(has(error_of([&] { export_h5(run, folder / "a.h5"); }).second, "exists already"));
  CHECK(fs::file_size(folder / "a.h5") == 8);
  const auto stop = [](std::int64_t, std::int64_t) { throw Error(ExitCode::failed, "stop"); };
  CHECK(error_of([&] { export_h5(run, folder / "b.h5", stop); }).second == "stop");
  CHECK_FALSE(fs::exists(folder / "b.h5"));
}

TEST_CASE("a run without records or axes can be exported") {
  const Folder folder;
  RunWriter(folder / "a.sqlite", {}).close("complete");
  CHECK(export_h5(RunReader(folder / "a.sqlite"), folder / "a.h5") == 0);
  CHECK(H5File::open(folder / "a.h5").shape("/entry/data/index") == H5Shape{0});
}

TEST_CASE("one record as CSV") {
  const Folder folder;
  write_run(folder / "a.sqlite", 3);
  const RunReader run(folder / "a.sqlite");
  export_csv(run, 2, folder / "a.csv");
  std::ifstream in(folder / "a.csv");
  std::stringstream text;
  text << in.rdbuf();
  CHECK(has(text.str(), "\nsensor,x,y,value\nspd,13343,,200\nspd,13443,,201\n"));
  CHECK(has(text.str(), "\nradar,1.5,,5.25\n"));
  CHECK(has(text.str(), "\ndepth,0.2,-0.1,17\n"));
  CHECK(has(error_of([&] { export_csv(run, 3, folder / "b.csv"); }).second, "no record 3"));
}

TEST_CASE("HDF5 errors name the file and the dataset, and print nothing else") {
  const Folder folder;
  const std::string path = folder / "m.h5";
  {
    H5File out = H5File::create(path);
    out.write<double>("layer/0/weights", {1, 2, 3, 4, 5, 6}, {2, 3});
    out.set("layer/0/weights", "loss", 0.5);
    out.set("/", "epochs", std::int64_t{7});
    out.write_text("name", "µ-Netz");
    CHECK(has(error_of([&] { out.write<float>("a", std::vector<float>(3), {2}); }).second,
              path + ": a: shape and number of values differ"));
    out.allocate<float>("rows", {3, 2});
    CHECK(has(error_of([&] { out.write_rows<float>("rows", 2, std::vector<float>(4)); }).second,
              "rows do not fit"));
    out.close();
  }
  const H5File in = H5File::open(path);
  CHECK(in.read<float>("layer/0/weights") == std::vector<float>{1, 2, 3, 4, 5, 6});
  CHECK(in.get<double>("layer/0/weights", "loss") == 0.5);
  CHECK(in.get<std::int64_t>("/", "epochs") == 7);
  CHECK(in.read_text("name") == "µ-Netz");
  CHECK(in.has("layer/0/weights"));
  CHECK_FALSE(in.has("layer/1/weights"));
  CHECK_FALSE(in.has_attribute("layer/1", "x"));
  CHECK(has(error_of([&] { in.read<float>("layer/9"); }).second,
            path + ": layer/9: no such dataset"));
  CHECK(has(error_of([&] { in.read<float>("name"); }).second, "name: cannot read as numbers"));
  CHECK(has(error_of([&] { in.get<double>("name", "x"); }).second, "name@x: no such attribute"));
  write_file(folder / "no.h5", "not HDF5");
  CHECK(has(error_of([&] { H5File::open(folder / "no.h5"); }).second, "not a readable HDF5 file"));
}
