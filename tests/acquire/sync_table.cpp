// SPDX-License-Identifier: MIT
// Tests the assignment of samples to records, by a table of arriving data with their expected
// records, and a table of expected verdicts.
#include <map>

#include "../catch.hpp"
#include "../fixtures/record.hpp"
#include "acquire/intake/window.hpp"

using namespace echofuse::acquire;
using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

constexpr SlotGrid grid{.first = 100s, .length = 1s};

HostTime host(double t) { return HostTime(std::llround(t * 1e9)); }

// Data that arrive at the host time `read`, in s. `taken` contains the times, in s, at which the
// device took the items. `places` contains one word per item: the index of the expected record, or
// early, late, outside or twice.
struct Event {
  double read;
  const char* device;
  std::vector<double> taken;
  const char* places;
  std::uint32_t number = 0;  // frame number
  std::uint64_t lost = 0;    // number of items lost before these data arrived
};

// clang-format off
const std::vector<Event> events = {
  // read     device   taken                                places           number lost
  { 99.992,  "spd",   {99.980, 99.990},                    "early early"              },
  { 99.993,  "radar", {99.985},                            "early",          1        },
  {100.004,  "spd",   {99.995, 99.999, 100.001, 100.003},  "early early 0 0"          },  // block that is split at the start of slot 0
  {100.031,  "radar", {99.9985},                           "early",          2        },  // frame read in slot 0, but taken before slot 0
  {100.300,  "radar", {100.280},                           "0",              3        },
  {100.310,  "depth", {100.290},                           "0",              1        },
  {100.610,  "depth", {100.490},                           "0",              2        },  // frame nearest to the centre of slot 0
  {100.640,  "depth", {100.620},                           "0",              3        },
  {100.641,  "depth", {100.620},                           "twice",          3        },
  {100.700,  "radar", {100.680},                           "0",              4        },
  {100.701,  "radar", {100.680},                           "twice",          4        },
  {100.720,  "spd",   {100.600, 100.700, 100.650, 100.719},"0 0 0 0"                  },  // block in which the tags are out of order
  {100.998,  "spd",   {100.990, 100.997},                  "0 0"                      },
  {101.120,  "spd",   {100.950, 100.999, 101.001, 101.110},"0 0 1 1"                  },  // block that spans 160 ms and is split at the boundary between slots 0 and 1
  {101.300,  "radar", {100.900},                           "0",              5        },  // frame that is read 0.4 s late, while slot 0 is still open
  {101.310,  "radar", {101.250},                           "1",              7,  1    },
  {101.320,  "radar", {101.200},                           "1",              6        },  // frames out of order
  {101.449,  "spd",   {100.994},                           "0"                        },  // tag that arrives during the grace time of slot 0
  {101.560,  "spd",   {100.995, 101.500},                  "late 1"                   },
  {101.565,  "spd",   {100.996, 100.997},                  "late late"                },  // a second block for the closed slot 0
  {101.570,  "radar", {100.999},                           "late",           8,  2    },  // slot 0 is already closed, so the lost frames are counted in slot 1
  {101.580,  "depth", {100.500},                           "late",           4        },
  {101.900,  "spd",   {101.850, 101.899},                  "1 1"                      },
  {102.100,  "depth", {101.999},                           "1",              5        },
  {102.110,  "depth", {102.000},                           "2",              6        },
  {102.200,  "spd",   {},                                  "",               0,  3    },  // block without tags that only reports 3 lost tags
  // The program stalls from 102.2 s to 105.7 s. All data that arrive during the stall are read at
  // the end of the stall.
  {105.700,  "spd",   {102.200, 102.900, 103.100, 105.690},"2 2 3 5"                  },
  {105.700,  "radar", {102.500},                           "2",              9        },
  {105.700,  "radar", {105.600},                           "5",             10        },
  // The radar reconnects, and its clock restarts. Arrival times are used until the fit of the new
  // clock is valid.
  {106.600,  "radar+",{106.100},                           "6",              1        },
  {106.700,  "spd",   {106.100, 106.650},                  "6 6"                      },
  {107.300,  "spd",   {107.001, 107.299},                  "outside outside"          },  // tags after the last slot
  {107.300,  "depth", {107.200},                           "outside",        7        },
};

struct Verdicts {
  std::int64_t record;
  const char *spd, *radar, *depth;
  std::uint32_t missing;  // bit mask of the required sensors that are missing; only the radar is required
  std::uint16_t depth_mm;  // number of the depth frame used; every pixel of a frame has this number as its value
};
const std::vector<Verdicts> verdicts = {
  {0, "ok",                          "ok",                      "ok",                      0, 2},
  {1, "ok",                          "ok",                      "ok",                      0, 5},
  {2, "ok",                          "ok",                      "ok",                      0, 6},
  {3, "the program stood still",     "the program stood still", "the program stood still", 2, 0},
  {4, "the program stood still",     "the program stood still", "the program stood still", 2, 0},
  {5, "the program stood still",     "ok",                      "the program stood still", 0, 0},  // the radar frame is assigned to this record by its device time stamp
  {6, "ok",                          "ok",                      "no frames",               0, 0},
};
// clang-format on

struct Device {
  double offset_s, drift, tick_s = 0;
  std::uint64_t at(double t) const {
    return static_cast<std::uint64_t>(std::llround((t * (1 + drift) + offset_s) / tick_s));
  }
};

// Simulates three devices and runs the daemon on a virtual clock. Each clock fit starts with 20 s
// of samples.
class Bench {
 public:
  Bench() {
    windows.announce(radar_of());
    windows.announce(camera_of(1, 1));
    for (double t = 79; t < 99; t += 0.05) {
      const Tag tag{.channel = 1, .time_ps = static_cast<std::int64_t>(tagger.at(t))};
      clocks.observe(TagBlock{.received = host(t), .tags = {&tag, 1}});
      clocks.observe(radar(t, t, 0));
      clocks.observe(depth(t, t, 0));
    }
    now = grid.first - 10ms;
  }

  void run(const Event& e) {
    std::istringstream places(e.places);
    const bool stood_still = e.read - seconds(now) > 2;
    while (!stood_still && now + 50ms <= host(e.read)) tick(now + 50ms);
    const std::string device = e.device;
    if (device == "spd") {
      std::vector<Tag> tags;
      for (const double t : e.taken)
        tags.push_back({.channel = 1, .time_ps = static_cast<std::int64_t>(tagger.at(t))});
      const TagBlock block{.received = host(e.read), .tags = tags, .lost_items = e.lost};
      clocks.observe(block);
      windows.add(block);
    } else if (device == "depth") {
      clocks.observe(depth(e.taken[0], e.read, e.number));
      windows.add(depth(e.taken[0], e.read, e.number));
    } else {
      if (device == "radar+") chirps.offset_s = -106;
      auto frame = radar(e.taken[0], e.read, e.number);
      frame.lost_before = static_cast<std::uint32_t>(e.lost);
      clocks.observe(frame);
      windows.add(frame);
    }
    const auto sensor = device == "spd" ? 0u : device == "depth" ? 2u : 1u;
    for (std::string place; places >> place;) ++expected[place][sensor];
    if (stood_still) tick(host(e.read));
  }

  void end() {
    scheduler.finish(grid.start(6));
    while (!scheduler.done()) tick(now + 50ms);
    windows.finish();
  }

  Device tagger{3, 100e-6, 1e-12}, chirps{-50, -150e-6, 5e-9}, camera{1000, 0, 1e-6};
  SensorClocks clocks;
  Windows windows{
      grid, {.first_bin_ps = 0, .bins = 1}, clocks, SensorSet::from_bits(7), {Sensor::radar}};
  Scheduler scheduler{grid};
  std::vector<record::FusedRecord> records;
  // Expected number of items from each sensor. The key is a record index or one of the words early,
  // late, outside and twice.
  std::map<std::string, std::array<std::uint64_t, 3>> expected;

 private:
  RadarFrame radar(double taken, double read, std::uint32_t number) const {
    RadarFrame f;
    f.received = host(read), f.frame_number = number, f.power = {1};
    f.time_cpu_cycles = static_cast<std::uint32_t>(chirps.at(taken));
    return f;
  }
  DepthFrame depth(double taken, double read, std::uint32_t number) const {
    DepthFrame f;
    f.received = host(read), f.device_time_us = camera.at(taken), f.frame_number = number;
    f.width = f.height = 1, f.depth_mm = {static_cast<std::uint16_t>(number)};
    return f;
  }
  void tick(HostTime t) {
    now = t;
    for (const DueSlot& due : scheduler.tick(now)) records.push_back(windows.close(due));
  }

  HostTime now;
};

}  // namespace

TEST_CASE("samples, losses and clock fits of all devices are assigned to the expected records") {
  Bench bench;
  for (const Event& e : events) bench.run(e);
  bench.end();
  REQUIRE(bench.records.size() == verdicts.size());
  for (const Verdicts& v : verdicts) {
    const auto& r = bench.records[static_cast<std::size_t>(v.record)];
    CAPTURE(v.record);
    CHECK((r.index == v.record && r.slot_start == grid.start(v.record)));
    CHECK(r.slot_end == r.slot_start + grid.length);
    for (const Sensor s : all_sensors) CHECK(r.has(s) == (verdict(r, s) == "ok"));
    CHECK(std::vector{verdict(r, Sensor::spd), verdict(r, Sensor::radar),
                      verdict(r, Sensor::depth)} ==
          std::vector<std::string>{v.spd, v.radar, v.depth});
    CHECK(r.missing.bits() == v.missing);
    CHECK(r.spd_counts.tags == bench.expected[std::to_string(v.record)][0]);
    CHECK(r.sync[Sensor::radar].used == bench.expected[std::to_string(v.record)][1]);
    CHECK((depth_mm(r).empty() ? 0 : depth_mm(r)[0]) == v.depth_mm);
  }
  const UnassignedSamples& unassigned = bench.windows.unassigned();
  CHECK(unassigned.early == bench.expected["early"]);
  CHECK(unassigned.outside == bench.expected["outside"]);
  CHECK(unassigned.late == bench.expected["late"]);
  CHECK(bench.windows.take_late() == record::LateCounts{{0, unassigned.late}});
  CHECK(bench.windows.take_late().empty());
  CHECK(unassigned.duplicate == bench.expected["twice"]);
  // Radar frame 6 arrives after frame 7. Frame 1 arrives after frame 10, like after a restart.
  CHECK(unassigned.out_of_order == std::array<std::uint64_t, 3>{0, 1, 0});
  // A loss is counted in the slot of the sample that reveals it. If that slot is closed, the loss
  // is counted in the next slot.
  CHECK(bench.records[1].sync[Sensor::radar].lost == 1 + 2);
  CHECK(bench.records[2].sync[Sensor::spd].lost == 3);

  // The clock fits of the devices are stored with each record. They hold at the centre of the slot.
  constexpr double centre_s = 102.5;
  for (const auto& [sensor, device] : {std::pair{Sensor::spd, Device{3, 100e-6}},
                                       {Sensor::radar, Device{-50, -150e-6}},
                                       {Sensor::depth, Device{1000, 0}}}) {
    const record::ClockState clock = bench.records[2].clocks[sensor].value();
    CHECK(clock.drift_ppm == Approx(1e6 * device.drift).margin(1));
    const double offset_s = -device.offset_s - centre_s * device.drift;
    if (sensor != Sensor::radar)  // the radar's clock wraps
      CHECK(clock.offset_s == Approx(offset_s).margin(1e-4));
  }
  CHECK(bench.records[0].sync[Sensor::spd].span_s == Approx(0.998).margin(1e-5));
  CHECK(bench.records[0].sync[Sensor::depth].offset_s == Approx(-0.01).margin(1e-5));
  CHECK(bench.records[0].sync[Sensor::radar].offset_s == Approx(0.12).margin(1e-5));
  CHECK_FALSE(bench.records[6].clocks[Sensor::radar]);  // the radar's clock restarted
}
