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

 private:
  void text(std::string value, std::size_t size) {
    value.resize(size, '\0');
    bytes_.insert(bytes_.end(), value.begin(), value.end());
  }
  Bytes bytes_;
};

constexpr std::uint32_t is_t2 = 0x01010204, is_t3 = 0x01010304;

// Returns a header without its end.
Tagged header(std::uint32_t type, double global_s, double dtime_s) {
  Tagged file("PQTTTR");
  file.whole("TTResultFormat_TTTRRecType", type).real("MeasDesc_GlobalResolution", global_s);
  return file.real("MeasDesc_Resolution", dtime_s);
}

// Returns a T2 record in version 2 of the HydraHarp format.
std::uint32_t t2(std::uint32_t channel, std::uint32_t time) { return channel << 25 | time; }
std::uint32_t t3(std::uint32_t channel, std::uint32_t dtime, std::uint32_t nsync) {
  return channel << 25 | dtime << 10 | nsync;
}
constexpr std::uint32_t special = 1u << 31;

// T2 records with overflow records between them.
struct T2Records {
  void reach(std::uint64_t ps) {
    for (; ps >> 25 > wraps; ++wraps) words.push_back(special | t2(63, 1));
  }
  void put(std::uint32_t word, std::uint64_t ps) {
    reach(ps);
    words.push_back(word | static_cast<std::uint32_t>(ps & 0x1ffffff));
  }
  std::vector<std::uint32_t> words{};
  std::uint64_t wraps = 0;
};

// Returns T3 records of 1000 pulses, each with a click.
std::vector<std::uint32_t> pulses() {
  std::vector<std::uint32_t> out;
  for (std::uint32_t k = 0; k < 1000; ++k) out.push_back(t3(0, 200, k));
  return out;
}

std::vector<std::pair<std::int32_t, std::int64_t>> tags_of(
    acquire::PicoquantRecords records, const std::vector<std::uint32_t>& words) {
  std::vector<Tag> tags;
  for (const auto word : words) REQUIRE(records.add(word, tags));
  std::vector<std::pair<std::int32_t, std::int64_t>> out;
  for (const Tag& t : tags) out.emplace_back(t.channel, t.time_ps);
  return out;
}

acquire::Config config_of(const Folder& folder) {
  write_file(folder / "lab.toml",
             "[tdc]\naddress = 'bridge:tcp://127.0.0.1:9'\nbins = 100\nfirst_bin_ps = 0\n"
             "[run]\nwindow_s = 0.5\n");
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
  for (const auto& [type, global_s] : {std::pair{0x00010408u, 1e-12}, {0x00010304u, 1e-7}})
    CHECK(error_of([=, t = type, s = global_s] { acquire::PicoquantRecords(t, s, 0); }).first ==
          ExitCode::failed);
}

TEST_CASE("import gives equal records for T2 and T3 recordings of the same photons") {
  const Folder folder;
  // Both recordings contain 1 s of laser pulses at 10 kHz with a click 5 ns after every 50th pulse.
  T2Records as_t2;
  std::vector<std::uint32_t> as_t3;
  std::uint64_t sync_wraps = 0;
  for (std::uint64_t pulse = 0; pulse < 10'000; ++pulse) {
    as_t2.put(special, pulse * 100'000'000);
    if (pulse % 50 != 0) continue;
    as_t2.put(0, pulse * 100'000'000 + 5000);
    for (; pulse / 1024 > sync_wraps; ++sync_wraps) as_t3.push_back(special | t3(63, 0, 1));
    as_t3.push_back(t3(0, 5, static_cast<std::uint32_t>(pulse % 1024)));
  }
  const char* const count = "TTResult_NumberOfRecords";
  Tagged a_ptu = header(is_t2, 1e-12, 0), b_ptu = header(is_t3, 1e-4, 1e-9);
  a_ptu.string("HW_Type", "HydraHarp 400").whole(count, std::ssize(as_t2.words)).end();
  a_ptu.data(as_t2.words).write(folder / "a.ptu");
  b_ptu.whole(count, std::ssize(as_t3) + 9).end().data(as_t3).write(folder / "b.ptu");
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
    T2Records out;
    for (std::uint64_t ps = 0; ps < 1'000'000'000'000; ps += 1'000'000'000)
      out.put(start, ps), out.put(click, ps + 5000);
    out.reach(dark_ps);
    return out.words;
  };
  const auto light = words(0, special, 0), dark = words(3'000'000'000'000, special, 0);
  const auto plain = [] { return header(is_t2, 1e-12, 0); };
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
  const auto says = [&](const Tagged& file, const std::string& expected,
                        ExitCode code = ExitCode::ok) {
    const auto said = import(file);
    CHECK(said.first == code);
    CHECK_THAT(said.second, Catch::Contains(expected));
  };
  const auto refuses = [&](const Tagged& file, const std::string& expected) {
    says(file, expected, ExitCode::failed);
  };
  says(plain().end().data(light), "2 records, spd in 2\n");
  refuses(plain().whole("Measurement_Mode", 3).end().data(light),
          "Measurement_Mode is T3, but TTResultFormat_TTTRRecType is T2");
  refuses(header(is_t3, 1e-4, 1e-12).whole("Measurement_Mode", 2).end().data(light),
          "Measurement_Mode is T2");
  // The duration of the dark period is determined by counting overflow records.
  const auto ended = import(plain().whole("TTResult_StopAfter", 3000).end().data(dark)).second;
  CHECK((has(ended, "6 records, spd in 2\n") && !has(ended, "duration")));
  says(plain().whole("TTResult_StopAfter", 5000).end().data(dark),
       "spd: duration: 5 s in the header, 3 s in the records\n");
  // The inserted overflow record spans 1126 s.
  auto jumps = light;
  jumps.insert(jumps.begin() + std::ssize(jumps) * 3 / 4, special | t2(63, 0x1ffffff));
  for (const char* part : {"2 records, spd in 1\n",
                           "spd: duration: 1 s in the header, 1126.9 s in "
                           "the records: records after"})
    says(plain().whole("MeasDesc_AcquisitionTime", 1000).end().data(jumps), part);
  jumps.assign({special, 5000, special | t2(63, 0x1ffffff), special, 5000});
  refuses(plain().end().data(jumps), "its times reach 1126 s, which gives more slots than the");
  refuses(plain().end().data(words(0, t2(0, 0), t2(1, 0))),
          "no events on the input selected by --start 0; inputs with events: 1, 2; did you mean "
          "--start 1 --click 2?");
  refuses(plain().end().data(words(0, special, t2(2, 0))),
          "no events on the input selected by --click 1; inputs with events: 0, 3; did you mean "
          "--start 0 --click 3?");
  // The recording contains events only in its first 0.05 s, which is a tenth of a slot.
  std::vector<std::uint32_t> begun(light.begin(), light.begin() + std::ssize(light) / 20);
  begun.push_back(special | t2(63, 100'000));
  refuses(plain().end().data(begun), "nothing to import: ");
  refuses(plain().end(), "no events on the input selected by --start 0; events by input: none");
  says(plain().end().data(light).data(Bytes{1, 2, 3}), "the last record is truncated");
  refuses(plain().end().data(saved_as_text(as_bytes(light))),
          "line ends were converted because the file was saved as text");
  says(header(is_t2, 250e-12, 0).end().data(light),
       "tag times are multiples of 250 ps, so bins of 100 ps have uneven widths; use --set "
       "tdc.bin_width_ps=250");
  CHECK(has(verdict(records_of(folder / ("t" + std::to_string(n) + ".sqlite"))[0], Sensor::spd),
            "100 % of the clicks are outside the histogram"));
  for (const double rate_hz : {1e3, 1e6}) {
    const auto said = [&](Tagged file, const auto& data) {
      return import(file.real("TTResult_SyncRate", rate_hz).end().data(data)).second;
    };
    CHECK(has(said(header(is_t3, 1e-3, 25e-12), pulses()), "TTResult_SyncRate") == (rate_hz > 1e3));
    const std::string text = said(plain(), light),
                      rate = "pulse rate: TTResult_SyncRate is 1e+06 Hz, ";
    CHECK(has(text, rate + "but the pulse rate in the records is 1000 Hz") == (rate_hz > 1e3));
    CHECK(has(text, "TTResult_SyncRate") == (rate_hz > 1e3));
  }
  refuses(header(is_t3, 1e-6, 25e-9).end().data(pulses()),
          "1000 clicks have times beyond the sync period of 1e-06 s; check MeasDesc_Resolution");
  auto swapped = light;
  for (std::size_t i = 1; i < swapped.size(); ++i)
    if (swapped[i] >> 25 == 0 && swapped[i - 1] >> 25 == special >> 25)
      std::swap(swapped[i - 1], swapped[i]), ++i;
  says(plain().end().data(swapped), "1000 events out of order by up to 1 us; the events were");

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
    const auto day = std::bit_cast<std::int64_t>(25569 + utc_s / 86400);
    Tagged file = header(is_t3, 1e-3, 25e-12);
    file.tag("File_CreatingTime", 0x21000008, day).end();
    file.data(pulses()).write(folder / "a.ptu");
    const std::string out = folder / std::to_string(utc_s) + ".sqlite";
    acquire::import_recordings(config_of(folder), {.files = {folder / "a.ptu"}, .out = out});
    CHECK(has(warnings_of(out), "which occurred twice at the end of") == (utc_s == 1698546600.0));
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
  config_of(folder);
  write_file(folder / "a.ptu", "PQTTTR");
  Tagged("PQTTTR").data(Bytes(20, 'x')).write(folder / "b.ptu");
  for (const char* name : {"a.dat", "a.phu", "a.ttbin"}) write_file(folder / name, "nothing");
  for (const char* name : {"kept", "raw"}) fs::create_directory(folder / name);
  write_file(folder / "raw/run.times", "");
  for (const auto& [file, code, words] :
       {std::tuple("a.ptu", 1, "does not begin with PQTTTR"),
        {"b.ptu", 1, "the header is not terminated"},
        {"a.dat", 3, "the board's .cfg is missing"},
        {"none.dat", 1, "none.dat: cannot read: No such file"},
        {"a.phu", 2, "convert the histograms with echofuse.write_run"},
        {"a.ttbin", 2, "only the Time Tagger library can read .ttbin"},
        {"lab.toml", 2, "expected NAME.dat (radar), NAME.ptu or one folder"},
        {"nowhere", 2, "nowhere: no such file or folder"},
        {"kept", 1, "kept: contains neither run.toml (arrays) nor run.times (raw capture)"},
        {"kept --cfg radar.cfg", 2, "--cfg cannot be used with a folder"},
        {"raw --began 2026-11-26", 2, "--began cannot be used with raw captures"}}) {
    const std::string command = "import --config " + folder / "lab.toml" + " --out ";
    CHECK_THAT(text_of(test::acquire(command + folder / "run" + " " + folder / file), code),
               Catch::Contains(words));
    CHECK_FALSE(fs::exists(folder / "run.sqlite"));
  }
}
