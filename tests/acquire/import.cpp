// SPDX-License-Identifier: MIT
// Tests the import of third-party recordings: PicoQuant files and radar frames in TI's format.
#include "acquire/import/import.hpp"

#include <bit>

#include "acquire/config/config.hpp"
#include "acquire/import/picoquant.hpp"
#include "drivers/core/bytes.hpp"
#include "testing.hpp"

namespace {

// Builds the little-endian tags of a .ptu header.
class Tagged {
 public:
  explicit Tagged(const std::string& magic) { text(magic, 8), text("1.0.00", 8); }
  Tagged& tag(const std::string& name, std::uint32_t type, std::int64_t value, int index = -1) {
    text(name, 32);
    put(bytes_, std::int32_t{index});
    put(bytes_, type);
    put(bytes_, value);
    return *this;
  }
  Tagged& whole(const std::string& name, std::int64_t value, int index = -1) {
    return tag(name, 0x10000008, value, index);
  }
  Tagged& real(const std::string& name, double value, int index = -1) {
    return tag(name, 0x20000008, std::bit_cast<std::int64_t>(value), index);
  }
  Tagged& string(const std::string& name, const std::string& value) {
    tag(name, 0x4001ffff, static_cast<std::int64_t>(value.size()));
    text(value, value.size());
    return *this;
  }
  Tagged& end() { return tag("Header_End", 0xffff0008, 0); }
  template <class T>
  Tagged& data(const std::vector<T>& values) {
    for (const T& v : values) put(bytes_, v);
    return *this;
  }
  void write(const std::string& path) const { write_file(path, {bytes_.begin(), bytes_.end()}); }
  std::size_t size() const { return bytes_.size(); }

 private:
  void text(std::string value, std::size_t size) {
    value.resize(size, '\0');
    bytes_.insert(bytes_.end(), value.begin(), value.end());
  }
  Bytes bytes_;
};

Tagged ptu(std::uint32_t type, double global_s, double dtime_s, std::size_t records) {
  Tagged file("PQTTTR");
  file.string("HW_Type", "HydraHarp 400").whole("TTResultFormat_TTTRRecType", type);
  file.real("MeasDesc_GlobalResolution", global_s).real("MeasDesc_Resolution", dtime_s);
  return file.whole("TTResult_NumberOfRecords", static_cast<std::int64_t>(records)).end();
}

// Returns a T2 record in version 2 of the HydraHarp format.
std::uint32_t t2(std::uint32_t channel, std::uint32_t time) { return channel << 25 | time; }
std::uint32_t t3(std::uint32_t channel, std::uint32_t dtime, std::uint32_t nsync) {
  return channel << 25 | dtime << 10 | nsync;
}
constexpr std::uint32_t special = 1u << 31;

std::vector<std::pair<std::int32_t, std::int64_t>> tags_of(
    acquire::PicoquantRecords records, const std::vector<std::uint32_t>& words) {
  std::vector<Tag> tags;
  for (const auto word : words) REQUIRE(records.add(word, tags));
  std::vector<std::pair<std::int32_t, std::int64_t>> out;
  for (const Tag& t : tags) out.emplace_back(t.channel, t.time_ps);
  return out;
}

acquire::Config config_of(const Folder& folder, double window_s = 0.5) {
  write_file(folder / "lab.toml",
             "[tdc]\naddress = \"bridge:tcp://127.0.0.1:9\"\nbins = 100\n"
             "first_bin_ps = 0\n[run]\nwindow_s = " +
                 std::to_string(window_s) + "\n");
  return acquire::load_config(folder / "lab.toml");
}

}  // namespace

TEST_CASE("import decodes the .ptu records of all supported PicoQuant devices") {
  using Tags = std::vector<std::pair<std::int32_t, std::int64_t>>;
  // HydraHarp format 2: a sync event, a click at input 1, a record of three overflows, a marker,
  // and a click at input 3
  CHECK(tags_of({0x01010204, 1e-12, 0}, {special | t2(0, 7), t2(0, 9), special | t2(63, 3),
                                         special | t2(1, 5), t2(2, 1)}) ==
        Tags{{0, 7}, {1, 9}, {3, 3 * 33'554'432 + 1}});
  // HydraHarp format 1: one overflow record means a single overflow after 33 552 000 time units
  CHECK(tags_of({0x00010204, 1e-12, 0}, {special | t2(63, 3), t2(0, 1)}) == Tags{{1, 33'552'001}});
  // MultiHarp T3: two clicks after one pulse, then a click after a later pulse
  CHECK(
      tags_of({0x00010307, 1e-7, 5e-12},
              {t3(0, 20, 4), t3(1, 30, 4), special | t3(63, 0, 2), t3(0, 1, 0)}) ==
      Tags{{0, 400'000}, {1, 400'100}, {2, 400'150}, {0, 2048 * 100'000}, {1, 2048 * 100'000 + 5}});
  // PicoHarp T2 with a resolution of 4 ps: a sync event, an overflow, a marker and a click at input
  // 1
  CHECK(tags_of({0x00010203, 4e-12, 0}, {5, 15u << 28, 15u << 28 | 1, 1u << 28 | 6}) ==
        Tags{{0, 20}, {1, 4 * (210'698'240 + 6)}});
  // PicoHarp T3: a click at input 1, an overflow and a click at input 2
  CHECK(tags_of({0x00010303, 1e-7, 4e-12},
                {1u << 28 | 10u << 16 | 3, 15u << 28, 2u << 28 | 1u << 16}) ==
        Tags{{0, 300'000}, {1, 300'040}, {0, 65536LL * 100'000}, {2, 65536LL * 100'000 + 4}});
  // the header tag MeasDesc_Offset delays all clicks by 40 ns
  CHECK(tags_of({0x00010307, 1e-7, 5e-12, 40}, {t3(0, 20, 4)}) == Tags{{0, 400'000}, {1, 440'100}});
  CHECK(tags_of({0x00010303, 1e-7, 4e-12, 40}, {1u << 28 | 10u << 16 | 3}) ==
        Tags{{0, 300'000}, {1, 340'040}});
  CHECK(error_of([] { acquire::PicoquantRecords(0x00010408, 1e-12, 0); }).first ==
        ExitCode::failed);
  CHECK(error_of([] { acquire::PicoquantRecords(0x00010304, 1e-7, 0); }).first == ExitCode::failed);
}

TEST_CASE("import gives equal records for T2 and T3 recordings of the same photons") {
  const Folder folder;
  // Both recordings contain 1 s of laser pulses at 10 kHz with a click 5 ns after every 50th pulse.
  std::vector<std::uint32_t> as_t2, as_t3;
  std::uint64_t wraps = 0, sync_wraps = 0;
  const auto at = [&](std::uint64_t ps, std::uint32_t word) {
    for (; ps >> 25 > wraps; ++wraps) as_t2.push_back(special | t2(63, 1));
    as_t2.push_back(word | static_cast<std::uint32_t>(ps & 0x1ffffff));
  };
  for (std::uint64_t pulse = 0; pulse < 10'000; ++pulse) {
    at(pulse * 100'000'000, special);
    if (pulse % 50 != 0) continue;
    at(pulse * 100'000'000 + 5000, 0);
    for (; pulse / 1024 > sync_wraps; ++sync_wraps) as_t3.push_back(special | t3(63, 0, 1));
    as_t3.push_back(t3(0, 5, static_cast<std::uint32_t>(pulse % 1024)));
  }
  ptu(0x01010204, 1e-12, 0, as_t2.size()).data(as_t2).write(folder / "a.ptu");
  ptu(0x01010304, 1e-4, 1e-9, as_t3.size() + 9).data(as_t3).write(folder / "b.ptu");
  const acquire::Config config = config_of(folder);
  acquire::import_recordings(
      config,
      {.files = {folder / "a.ptu"}, .began = "2024-02-07T12:34:56.5Z", .out = folder / "a.sqlite"});
  acquire::import_recordings(config, {.files = {folder / "b.ptu"}, .out = folder / "b.sqlite"});
  const std::string said = warnings_of(folder / "b.sqlite");
  CHECK(has(said, "the header specifies 218 records, but the file contains 209"));
  CHECK(has(said, "start time unknown"));
  const record::RunReader a(folder / "a.sqlite"), b(folder / "b.sqlite");
  CHECK(a.info().started_utc == "2024-02-07T12:34:56.500Z");
  CHECK(a.devices().at(0).model == "HydraHarp 400");
  for (const record::RunReader* run : {&a, &b}) {
    REQUIRE(run->count() == 2);
    for (const std::int64_t i : {0, 1}) {
      const record::FusedRecord r = run->read(i);
      CHECK(r.has(Sensor::spd));
      CHECK(counts(r).at(50) == 100);
      CHECK(r.spd_counts.in_range == 100);
      CHECK(r.spd_counts.starts == (run == &a ? 5000u : 100u));
      CHECK(r.slot_end - r.slot_start == from_seconds(0.5));
      CHECK(r.slot_utc - run->read(0).slot_utc == r.slot_start);
      CHECK(r.sync[Sensor::radar].verdict.text() == "not configured");
    }
  }
}

TEST_CASE("import checks the header of a .ptu file against its records") {
  const Folder folder;
  const acquire::Config config = config_of(folder);
  // Returns the T2 records of 1 s of laser pulses at 1 kHz, with a click 5 ns after each pulse,
  // followed by a period of `dark_ps` without pulses.
  const auto words = [](std::uint64_t dark_ps, std::uint32_t start, std::uint32_t click) {
    std::vector<std::uint32_t> out;
    std::uint64_t wraps = 0;
    const auto reach = [&](std::uint64_t ps) {
      for (; ps >> 25 > wraps; ++wraps) out.push_back(special | t2(63, 1));
    };
    for (std::uint64_t ps = 0; ps < 1'000'000'000'000; ps += 1'000'000'000)
      for (const auto& [word, time] : {std::pair{start, ps}, {click, ps + 5000}}) {
        reach(time);
        out.push_back(word | static_cast<std::uint32_t>(time & 0x1ffffff));
      }
    reach(dark_ps);
    return out;
  };
  const auto light = words(0, special, 0);
  const auto header = [](std::uint32_t type, double global_s, double dtime_s) {
    Tagged file("PQTTTR");
    file.whole("TTResultFormat_TTTRRecType", type).real("MeasDesc_GlobalResolution", global_s);
    return file.real("MeasDesc_Resolution", dtime_s);
  };
  constexpr std::uint32_t is_t2 = 0x01010204, is_t3 = 0x01010304;
  const auto plain = [&] { return header(is_t2, 1e-12, 0); };
  int n = 0;
  const auto import = [&](const Tagged& file, const std::string& more = "") {
    const std::string name = folder / ("t" + std::to_string(++n));
    file.write(name + ".ptu");
    std::vector<std::string> files{name + ".ptu"};
    if (!more.empty()) files.push_back(more);
    const auto [code, text] = error_of([&] {
      const std::string said = acquire::import_recordings(
          config, {.files = files,
                   .cfg = test::source_dir + "/config/radar/xwr68xx_44mm.cfg",
                   .out = name + ".sqlite"});
      throw Error(ExitCode::ok, said + warnings_of(name + ".sqlite"));
    });
    CAPTURE(text);
    CHECK(fs::exists(name + ".sqlite") == (code == ExitCode::ok || code == ExitCode::partial));
    return std::pair{code, text};
  };
  const auto says = [&](const Tagged& file, ExitCode code, const std::string& expected) {
    const auto said = import(file);
    CAPTURE(said.second, expected);
    CHECK((said.first == code && has(said.second, expected)));
  };
  const auto said = import(plain().end().data(light));
  CHECK((said.first == ExitCode::ok && has(said.second, "2 records, spd in 2\n")));

  says(plain().whole("Measurement_Mode", 3).end().data(light), ExitCode::failed,
       "Measurement_Mode is T3, but TTResultFormat_TTTRRecType is T2");
  says(header(is_t3, 1e-4, 1e-12).whole("Measurement_Mode", 2).end().data(light), ExitCode::failed,
       "Measurement_Mode is T2");
  // The duration of the dark period is determined by counting overflow records.
  const auto dark = words(3'000'000'000'000, special, 0);
  const auto ended = import(plain().whole("TTResult_StopAfter", 3000).end().data(dark));
  CHECK((has(ended.second, "6 records, spd in 2\n") && !has(ended.second, "duration")));
  says(plain().whole("TTResult_StopAfter", 5000).end().data(dark), ExitCode::ok,
       "spd: duration: 5 s in the header, 3 s in the records\n");
  // The inserted overflow record spans 1126 s.
  auto jumps = light;
  jumps.insert(jumps.begin() + std::ssize(jumps) * 3 / 4, special | t2(63, 0x1ffffff));
  says(plain().whole("MeasDesc_AcquisitionTime", 1000).end().data(jumps), ExitCode::ok,
       "2 records, spd in 1\n");
  says(plain().whole("MeasDesc_AcquisitionTime", 1000).end().data(jumps), ExitCode::ok,
       "spd: duration: 1 s in the header, 1126.9 s in the records: records after");
  jumps.assign({special, 5000, special | t2(63, 0x1ffffff), special, 5000});
  says(plain().end().data(jumps), ExitCode::failed,
       "its times reach 1126 s, which gives more slots than the file has bytes");

  says(plain().end().data(words(0, t2(0, 0), t2(1, 0))), ExitCode::failed,
       "no events on the input selected by --start 0; inputs with events: 1, 2; did you mean "
       "--start 1 --click 2?");
  says(plain().end().data(words(0, special, t2(2, 0))), ExitCode::failed,
       "no events on the input selected by --click 1; inputs with events: 0, 3; did you mean "
       "--start 0 --click 3?");
  // The recording contains events only in its first 0.05 s, which is a tenth of a slot.
  std::vector<std::uint32_t> begun(light.begin(), light.begin() + std::ssize(light) / 20);
  begun.push_back(special | t2(63, 100'000));
  says(plain().end().data(begun), ExitCode::failed, "nothing to import: ");
  says(plain().end(), ExitCode::failed,
       "no events on the input selected by --start 0; events by input: none");
  says(plain().end().data(light).data(std::vector<std::uint8_t>{1, 2, 3}), ExitCode::ok,
       "the last record is truncated");
  std::vector<std::uint8_t> saved_as_text;
  for (const std::uint8_t b : as_bytes(light)) {
    if (b == '\n') saved_as_text.push_back('\r');
    saved_as_text.push_back(b);
  }
  says(plain().end().data(saved_as_text), ExitCode::failed,
       "line ends were converted because the file was saved as text");
  says(header(is_t2, 250e-12, 0).end().data(light), ExitCode::ok,
       "tag times are multiples of 250 ps, so bins of 100 ps have uneven widths; use --set "
       "tdc.bin_width_ps=250");
  CHECK(has(record::RunReader(folder / ("t" + std::to_string(n) + ".sqlite"))
                .read(0)
                .sync[Sensor::spd]
                .text(),
            "100 % of the clicks are outside the histogram"));
  std::vector<std::uint32_t> pulses;
  for (std::uint32_t k = 0; k < 1000; ++k) pulses.push_back(t3(0, 200, k));
  for (const double rate_hz : {1e3, 1e6})
    CHECK(has(import(
                  header(is_t3, 1e-3, 25e-12).real("TTResult_SyncRate", rate_hz).end().data(pulses))
                  .second,
              "TTResult_SyncRate") == (rate_hz == 1e6));

  says(plain().real("TTResult_SyncRate", 80e6).end().data(light), ExitCode::ok,
       "pulse rate: TTResult_SyncRate is 8e+07 Hz, but the pulse rate in the records is 1000 Hz");
  CHECK_FALSE(has(import(plain().real("TTResult_SyncRate", 1e3).end().data(light)).second,
                  "TTResult_SyncRate"));
  says(header(is_t3, 1e-6, 25e-9).end().data(pulses), ExitCode::failed,
       "1000 clicks have times beyond the sync period of 1e-06 s; check MeasDesc_Resolution");
  auto swapped = light;
  for (std::size_t i = 1; i < swapped.size(); ++i)
    if (swapped[i] >> 25 == 0 && swapped[i - 1] >> 25 == special >> 25)
      std::swap(swapped[i - 1], swapped[i]), ++i;
  says(plain().end().data(swapped), ExitCode::ok,
       "spd: 1000 events out of order by up to 1 us; the events were sorted");

  // If only one of two recordings is invalid, the run is still written and the exit code is
  // `partial`.
  write_file(folder / "a.dat", "nothing");
  const auto both = import(plain().end().data(light), folder / "a.dat");
  CAPTURE(both.second);
  CHECK((both.first == ExitCode::partial && has(both.second, "spd in 2") &&
         has(both.second, "a.dat: nothing to import")));
  plain().end().data(light).write(folder / "second.ptu");
  const auto two = import(plain().end().data(light), folder / "second.ptu");
  CHECK(two == std::pair{ExitCode::usage,
                         std::string("two time tagger recordings; expected one per sensor")});
}

TEST_CASE("import reports an ambiguous local time at the end of summer time") {
  const Folder folder;
  const char* const zone = std::getenv("TZ");
  const std::string before = zone ? zone : "";
  ::setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3", 1);
  ::tzset();
  // The local times are 02:30 and 05:30 on 29 October 2023. Only the first one is ambiguous.
  for (const double utc_s : {1698546600.0, 1698557400.0}) {
    std::vector<std::uint32_t> words;
    for (std::uint32_t k = 0; k < 1000; ++k) words.push_back(t3(0, 200, k));
    Tagged file("PQTTTR");
    file.whole("TTResultFormat_TTTRRecType", 0x01010304).real("MeasDesc_GlobalResolution", 1e-3);
    file.real("MeasDesc_Resolution", 25e-12);
    file.tag("File_CreatingTime", 0x21000008, std::bit_cast<std::int64_t>(25569 + utc_s / 86400));
    file.end().data(words).write(folder / "a.ptu");
    const std::string out = folder / std::to_string(utc_s);
    acquire::import_recordings(config_of(folder),
                               {.files = {folder / "a.ptu"}, .out = out + ".sqlite"});
    const std::string said = warnings_of(out + ".sqlite");
    CHECK(has(said, "which occurred twice at the end of summer time") == (utc_s == 1698546600.0));
  }
  zone ? ::setenv("TZ", before.c_str(), 1) : ::unsetenv("TZ");
  ::tzset();
}

TEST_CASE("import accepts a start time with or without a UTC offset and refuses invalid times") {
  const auto at = [](const char* text) { return acquire::parse_utc(text).count() / 1'000'000; };
  CHECK(at("2024-02-07T13:34:56.5+01:00") == at("2024-02-07T12:34:56.5Z"));
  CHECK(at("2024-02-07 07:04:56.5-0530") == at("2024-02-07T12:34:56.5"));
  CHECK(at("2024-02-29") == at("2024-02-29T00:00:00Z"));
  for (const char* text :
       {"2024-02-30", "2023-02-29T12:00:00Z", "2024-02-07T12:00:00+1", "2024-02-07T12:00:00+15:00",
        "2024-02-07T12:00:00+01:00Z", "noon", "2024-02-07T12:34:56.9e300",
        "2024-02-07T12:34:56.9e3Z", "2024-02-07T12:34:56."})
    CHECK(error_of([&] { at(text); }).first == ExitCode::usage);
}

TEST_CASE("import refuses an invalid recording with a one-line message") {
  const Folder folder;
  write_file(folder / "a.ptu", "PQTTTR");
  write_file(folder / "b.ptu", std::string("PQTTTR\0\0"
                                           "1.0.00\0\0",
                                           16) +
                                   std::string(20, 'x'));
  write_file(folder / "a.dat", "nothing");
  write_file(folder / "a.ttbin", "");
  config_of(folder);
  const auto refuses = [&](const std::string& file, int code, const std::string& saying) {
    const std::string command = "import --config " + folder / "lab.toml" + " --out ";
    CHECK_THAT(text_of(test::acquire(command + folder / "run" + " " + folder / file), code),
               Catch::Contains(saying));
    CHECK_FALSE(fs::exists(folder / "run.sqlite"));
  };
  refuses("a.ptu", 1, "does not begin with PQTTTR");
  refuses("b.ptu", 1, "the header is not terminated");
  refuses("a.dat", 3, "the board's .cfg is missing");
  refuses("none.dat", 1, "none.dat: cannot read: No such file");
  write_file(folder / "a.phu", "");
  refuses("a.phu", 2, "convert the histograms with echofuse.write_run");
  refuses("a.ttbin", 2, "only the Time Tagger library can read .ttbin");
  refuses("lab.toml", 2, "expected NAME.dat (radar), NAME.ptu or one folder");
  refuses("nowhere", 2, "nowhere: no such file or folder");
  fs::create_directory(folder / "kept");
  refuses("kept", 1, "kept: contains neither run.toml (arrays) nor run.times (raw capture)");
  refuses("kept --cfg " + folder / "radar.cfg", 2, "--cfg cannot be used with a folder");
  write_file(folder / "kept/run.times", "");
  refuses("kept --began 2026-11-26", 2, "--began cannot be used with raw captures");
}
