// SPDX-License-Identifier: MIT
// Reads the blocks of the simulated detectors through TCP, without their driver.
#include <deque>
#include <optional>

#include "../drivers/sink.hpp"
#include "../fixtures/wire.hpp"
#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "lab_thread.hpp"

using namespace echofuse::test;
using namespace std::chrono_literals;
using bridge::BlockKind;

namespace {

struct Block {
  BlockKind kind{};
  std::uint32_t sequence = 0;
  std::uint64_t dropped = 0;
  Bytes payload{};
  std::vector<Tag> tags() const { return to_values<Tag>(payload); }
};

class Client {
 public:
  Client(port::Loop& loop, const std::string& address) : loop_(loop) {
    port_ = loop_.opener(address)();
    port_->open({.opened = [] {},
                 .bytes = [this](ByteView bytes) { parser_.feed(bytes, keep_); },
                 .gone = [this](const Failure&) { ended_ = true; }});
  }
  // Returns the next block, or nothing at the end of the stream.
  std::optional<Block> read() {
    REQUIRE(run_until(loop_, [&] { return ended_ || !blocks_.empty(); }));
    REQUIRE_FALSE(parser_.broken());
    if (blocks_.empty()) return {};
    Block next = std::move(blocks_.front());
    blocks_.pop_front();
    return next;
  }
  // Returns the blocks that have arrived.
  std::deque<Block> received() { return std::exchange(blocks_, {}); }
  // Returns the next block. The stream must not have ended.
  Block next() {
    const std::optional<Block> block = read();
    REQUIRE(block);
    return *block;
  }

 private:
  std::deque<Block> blocks_;
  bool ended_ = false;
  bridge::BlockParser parser_;
  bridge::BlockParser::OnBlock keep_ = [this](const bridge::Block& b) {
    blocks_.push_back({b.kind, b.sequence, b.dropped_items, {b.payload.begin(), b.payload.end()}});
  };
  port::Loop& loop_;
  std::unique_ptr<port::BytePort> port_;
};

// Returns the address of the tagger of a laboratory.
std::string address_in(const sim::LabOptions& options) {
  const std::string toml = contents(options.dir + "/lab.toml");
  const std::size_t at = toml.find("bridge:tcp://");
  return toml.substr(at, toml.find('"', at) - at);
}

// Returns the expected number of photons per second from the person in the scene of options_in().
double photons_per_s(const sim::LabOptions& options) {
  const auto returns = sim::spd_returns(
      sim::make_scene(options.conditions, sim::SceneKind::person, 5, 0), options.conditions);
  return std::accumulate(returns.weight.begin(), returns.weight.end(), 0.0) *
         options.conditions.signal_photons / options.window_s;
}

void check_count(double count, double expected) {
  REQUIRE(expected > 1e4);
  CHECK(std::abs(count - expected) < 5 * std::sqrt(expected));
}

}  // namespace

TEST_CASE("the simulated time tagger sends a hello block, then tags at the rate of the scene") {
  const Folder dir;
  const sim::LabOptions options = options_in(dir, {"person", 5, 0});
  LabThread lab(options);
  port::SystemLoop loop;
  Client client(loop, address_in(options));
  const Block hello = client.next();
  CHECK(hello.kind == BlockKind::hello);
  CHECK(hello.sequence == 0);
  CHECK(std::string(hello.payload.begin(), hello.payload.end()) ==
        R"({"model":"simulated time tagger","serial":"SIM-TDC-1","firmware":"1.0"})");

  std::vector<Tag> tags;
  std::uint32_t blocks = 0, hellos = 0;
  while (tags.empty() || tags.back().time_ps - tags.front().time_ps < 1'500'000'000'000) {
    const Block block = client.next();
    REQUIRE(block.sequence == ++blocks);
    REQUIRE(block.dropped == 0);
    if (block.kind == BlockKind::hello) {
      CHECK(block.payload == hello.payload);
      ++hellos;
      continue;
    }
    REQUIRE(block.kind == BlockKind::tags);
    const auto more = block.tags();
    tags.insert(tags.end(), more.begin(), more.end());
  }
  // The tagger sends at least one block every 20 ms, which gives 75 blocks in 1.5 s. A hello block
  // is sent about once per second.
  CHECK(blocks >= 75);
  CHECK(hellos >= 1);
  CHECK(hellos <= 2);
  double photons = 0;
  for (std::size_t i = 1; i < tags.size(); ++i) {
    REQUIRE(tags[i].is_time_tag());
    REQUIRE(tags[i].time_ps >= tags[i - 1].time_ps);
    photons += tags[i].channel == 2;
  }
  check_count(photons, photons_per_s(options) *
                           static_cast<double>(tags.back().time_ps - tags.front().time_ps) * 1e-12);
}

TEST_CASE("the simulated zone detector sends histograms at the rate of the scene") {
  const Folder dir;
  sim::LabOptions options = options_in(dir, {"person", 5, 0});
  options.conditions.spd_zones = 3;
  LabThread lab(options);
  port::SystemLoop loop;
  Client client(loop, address_in(options));
  const auto hello = bridge::read_hello(client.next().payload);
  REQUIRE(hello);
  CHECK(hello->sends == "histograms");
  CHECK(hello->zones.size() == 9);
  double counts = 0;
  std::uint64_t before_us = 0;
  for (int histograms = 0; histograms < 20;) {
    const Block block = client.next();
    if (block.kind == BlockKind::hello) continue;
    REQUIRE(block.kind == BlockKind::histogram);
    const auto read = bridge::read_histogram(block.payload);
    REQUIRE(read);
    const HistogramFrame& frame = read->frame;
    CHECK(frame.zones == 9);
    CHECK(frame.exposure_us == 50'000);
    CHECK(frame.device_time_us >= before_us);
    before_us = frame.device_time_us;
    CHECK(read->axis.count == options.conditions.bins);
    CHECK(read->axis.start == options.conditions.first_bin_ps);
    CHECK(read->axis.step == options.conditions.bin_width_ps);
    counts += static_cast<double>(frame.clicks());
    ++histograms;
  }
  check_count(counts, photons_per_s(options) * 0.05 * 20);
}

TEST_CASE(
    "each client of the simulated tagger gets a new stream, which ends with a goodbye block") {
  const Folder dir;
  const sim::LabOptions options = options_in(dir, {"person", 5, 0});
  LabThread lab(options);
  port::SystemLoop loop;
  for (int i = 0; i < 3; ++i) {
    Client client(loop, address_in(options));
    for (std::uint32_t sequence = 0; sequence < 4; ++sequence) {
      const Block block = client.next();
      CHECK(block.sequence == sequence);
      CHECK((sequence > 0 || block.kind == BlockKind::hello));
    }
  }
  Client client(loop, address_in(options));
  client.next();
  lab.stop();
  std::optional<Block> last, block;
  while ((block = client.read())) last = block;
  CHECK(last->kind == BlockKind::bye);
  CHECK(last->payload.empty());
}

TEST_CASE("the simulated bridge reports tags lost by a slow client in the next block header") {
  const Folder dir;
  sim::LabOptions options = options_in(dir, {"person", 5, 0});
  // 4e6 tags per second (64 MB/s) exceed the capacity of the queue and the socket.
  options.window_s = 0.05;
  LabThread lab(options);
  port::SystemLoop loop;
  Client client(loop, address_in(options));
  client.next();
  std::this_thread::sleep_for(800ms);
  std::uint64_t dropped = 0;
  std::int64_t gap_ps = 0, last_ps = 0;
  for (std::uint32_t sequence = 1; gap_ps == 0; ++sequence) {
    const Block block = client.next();
    REQUIRE(block.sequence == sequence);
    dropped += block.dropped;
    if (block.kind == BlockKind::hello) continue;
    const auto more = block.tags();
    REQUIRE_FALSE(more.empty());
    if (dropped > 0) gap_ps = more.front().time_ps - last_ps;
    last_ps = more.back().time_ps;
  }
  // The number of dropped tags must equal the tag rate of the scene multiplied by the duration of
  // the gap between the received tags.
  const double pulses_hz = options.tagging.laser_rate_hz, photons_hz = photons_per_s(options);
  const double tags_hz = photons_hz + pulses_hz * -std::expm1(-photons_hz / pulses_hz);
  const double expected = tags_hz * static_cast<double>(gap_ps) * 1e-12;
  CHECK(std::abs(static_cast<double>(dropped) - expected) < 5 * 2 * std::sqrt(expected));
}

TEST_CASE("a fault of the simulated tagger changes its stream only while the fault lasts") {
  using sim::FaultKind;
  struct Row {
    FaultKind kind;
    double amount;
    std::vector<double> blocks;   // per second; the fault lasts from 1 s to 2 s
    std::vector<double> photons;  // per second, as multiples of the rate of the scene
  };
  const Row row = GENERATE(Row{FaultKind::drop, 0.25, {200, 150, 200}, {1, 0.75, 1}},
                           Row{FaultKind::stall, 0, {200, 0, 400}, {1, 0, 2}},
                           Row{FaultKind::late, 0.25, {200, 150, 250}, {1, 0.75, 1.25}},
                           Row{FaultKind::gain, 0.5, {200, 200, 200}, {1, 0.5, 1}},
                           Row{FaultKind::clock_offset, 0.5, {200, 200, 200}, {1, 1, 1}},
                           Row{FaultKind::corrupt, 1, {200, 0, 0}, {1, 0, 0}},
                           Row{FaultKind::garbage, 64, {200, 0, 0}, {1, 0, 0}},
                           Row{FaultKind::unplug, 0, {200, 0, 0}, {1, 0, 0}});
  CAPTURE(sim::name_of(row.kind));
  port::VirtualLoop loop;
  sim::LabOptions conditions;
  sim::ScenePlayer player(loop, conditions.conditions, {"person", 5, 0});
  auto listener = std::make_unique<MemoryListener>(loop);
  loop.ports["tagger"] = listener->opener();
  sim::TdcOptions options;
  options.plan.faults = {{"tdc", row.kind, 1, 1, 0, row.amount}};
  const auto tagger = sim::make_tdc_bridge(loop, player, options, std::move(listener));
  Client client(loop, "tagger");
  for (std::size_t second = 0; second < 3; ++second) {
    CAPTURE(second);
    loop.run_for(1s);
    double blocks = 0, photons = 0, sum_s = 0;
    for (const Block& block : client.received()) {
      if (block.kind != BlockKind::tags) continue;
      ++blocks;
      for (const Tag& tag : block.tags()) {
        if (tag.channel != 2) continue;
        ++photons;
        sum_s += static_cast<double>(tag.time_ps) * 1e-12;
      }
    }
    CHECK(std::abs(blocks - row.blocks[second]) < 30);
    const double expected = photons_per_s(conditions) * row.photons[second];
    CHECK(std::abs(photons - expected) < 5 * std::sqrt(expected) + 0.1 * photons_per_s(conditions));
    const bool offset = row.kind == FaultKind::clock_offset && second == 1;
    const double middle_s = static_cast<double>(second) + (offset ? 1 : 0.5);
    if (row.blocks[1] == 200) CHECK(sum_s / photons == Approx(middle_s).margin(0.02));
  }
  CHECK(tagger->sent().front() == std::pair<std::string, std::uint64_t>("clients", 1));
  CHECK(tagger->sent().back() == std::pair<std::string, std::uint64_t>("dropped", 0));
  tagger->stop();
  loop.run_for(1s);
}
