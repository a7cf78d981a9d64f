// SPDX-License-Identifier: MIT
// Reads the simulated time tagger through a plain socket, without the driver.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <optional>

#include "drivers/core/bytes.hpp"
#include "drivers/core/sample.hpp"
#include "lab_thread.hpp"

using namespace echofuse::test;

namespace {

// Computes the CRC bit by bit, without the lookup table used by the product code.
std::uint32_t slow_crc32c(ByteView bytes, std::uint32_t crc) {
  crc = ~crc;
  for (const std::uint8_t b : bytes) {
    crc ^= b;
    for (int k = 0; k < 8; ++k) crc = (crc >> 1) ^ ((crc & 1) ? 0x82f63b78U : 0U);
  }
  return ~crc;
}

struct Block {
  std::uint16_t version, kind;
  std::uint32_t sequence;
  std::uint64_t dropped;
  Bytes payload;
  std::vector<Tag> tags() const { return to_values<Tag>(payload); }
};

class Client {
 public:
  explicit Client(const std::string& toml_path) {
    const std::string toml = contents(toml_path), before = "bridge:tcp://127.0.0.1:";
    const int port = std::stoi(toml.substr(toml.find(before) + before.size()));
    fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const timeval patience{3, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    REQUIRE(::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
  }
  ~Client() { ::close(fd_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // Returns the next block, which must be undamaged, or nothing at the end of the stream.
  std::optional<Block> read() {
    Bytes head;
    if (!read_exactly(head, 32)) return {};
    REQUIRE(std::memcmp(head.data(), "EFBR", 4) == 0);
    ByteReader fields{ByteView(head).subspan(4)};
    Block block{};
    block.version = fields.get<std::uint16_t>();
    block.kind = fields.get<std::uint16_t>();
    block.sequence = fields.get<std::uint32_t>();
    const auto size = fields.get<std::uint32_t>();
    block.dropped = fields.get<std::uint64_t>();
    REQUIRE(fields.get<std::uint32_t>() == 0);
    const auto crc = fields.get<std::uint32_t>();
    REQUIRE(size <= 16U << 20);
    REQUIRE(read_exactly(block.payload, size));
    REQUIRE(crc == slow_crc32c(block.payload, slow_crc32c(ByteView(head).first(28), 0)));
    return block;
  }
  // Returns the next block. The stream must not have ended.
  Block next() {
    const std::optional<Block> block = read();
    REQUIRE(block);
    return *block;
  }

 private:
  bool read_exactly(Bytes& out, std::size_t size) {
    out.resize(size);
    return size == 0 || ::recv(fd_, out.data(), size, MSG_WAITALL) == static_cast<ssize_t>(size);
  }
  int fd_;
};

// Returns the expected number of photons per second from the person in the scene of options_in().
double photons_per_s(const sim::LabOptions& options) {
  const auto returns = sim::spd_returns(
      sim::make_scene(options.conditions, sim::SceneKind::person, 5, 0), options.conditions);
  return std::accumulate(returns.weight.begin(), returns.weight.end(), 0.0) *
         options.conditions.signal_photons / options.window_s;
}

}  // namespace

TEST_CASE("the simulated time tagger sends a hello block, then tags at the rate of the scene") {
  const Folder dir;
  const sim::LabOptions options = options_in(dir, {"person", 5, 0});
  LabThread lab(options);
  Client client(options.dir + "/lab.toml");
  const Block hello = client.next();
  CHECK(hello.kind == 0);
  CHECK(hello.version == 1);
  CHECK(hello.sequence == 0);
  CHECK(std::string(hello.payload.begin(), hello.payload.end()) ==
        R"({"model":"simulated time tagger","serial":"SIM-TDC-1","firmware":"1.0"})");

  std::vector<Tag> tags;
  const auto start = std::chrono::steady_clock::now();
  int blocks = 0, hellos = 0;
  for (; std::chrono::steady_clock::now() - start < std::chrono::milliseconds(1500); ++blocks) {
    const Block block = client.next();
    REQUIRE(block.sequence == static_cast<std::uint32_t>(blocks + 1));
    REQUIRE(block.dropped == 0);
    if (block.kind == 0) {
      CHECK(block.payload == hello.payload);
      ++hellos;
      continue;
    }
    REQUIRE(block.kind == 1);
    const auto more = block.tags();
    tags.insert(tags.end(), more.begin(), more.end());
  }
  // The tagger sends at least one block every 20 ms, which gives 75 blocks in 1.5 s.
  CHECK(blocks >= 75);
  // A hello block is sent about once per second, so at least one arrives in 1.5 s.
  CHECK(hellos >= 1);
  double photons = 0;
  for (std::size_t i = 1; i < tags.size(); ++i) {
    REQUIRE(tags[i].type == TagType::time_tag);
    REQUIRE(tags[i].time_ps > tags[i - 1].time_ps - 1);
    photons += tags[i].channel == 2;
  }
  const double expected = photons_per_s(options) *
                          static_cast<double>(tags.back().time_ps - tags.front().time_ps) * 1e-12;
  REQUIRE(expected > 1e4);
  CHECK(std::abs(photons - expected) < 5 * std::sqrt(expected));
}

TEST_CASE("the simulated zone detector sends histograms at the rate of the scene") {
  const Folder dir;
  sim::LabOptions options = options_in(dir, {"person", 5, 0});
  options.conditions.spd_zones = 3;
  LabThread lab(options);
  Client client(options.dir + "/lab.toml");
  const Block hello = client.next();
  const std::string text(hello.payload.begin(), hello.payload.end());
  CHECK(text.find("\"sends\":\"histograms\"") != std::string::npos);
  CHECK(std::count(text.begin(), text.end(), '{') == 1 + 9);
  double counts = 0;
  int histograms = 0;
  while (histograms < 20) {
    const Block block = client.next();
    if (block.kind == 0) continue;
    REQUIRE(block.kind == 4);
    ByteReader in(block.payload);
    CHECK(in.get<std::uint32_t>() == 9);
    const auto bins = in.get<std::uint32_t>();
    CHECK(bins == options.conditions.bins);
    CHECK(in.take(36).size() == 36);
    REQUIRE(in.left() == std::size_t{4} * 9 * bins);
    for (const auto n : to_values<std::uint32_t>(in.take(in.left()))) counts += n;
    ++histograms;
  }
  const double expected = photons_per_s(options) * 0.05 * histograms;
  REQUIRE(expected > 1e4);
  CHECK(std::abs(counts - expected) < 5 * std::sqrt(expected));
}

TEST_CASE(
    "each client of the simulated tagger gets a new stream, which ends with a goodbye block") {
  const Folder dir;
  const sim::LabOptions options = options_in(dir, {"person", 5, 0});
  LabThread lab(options);
  for (int i = 0; i < 3; ++i) {
    Client client(options.dir + "/lab.toml");
    for (std::uint32_t sequence = 0; sequence < 4; ++sequence) {
      const Block block = client.next();
      CHECK(block.sequence == sequence);
      CHECK((sequence > 0 || block.kind == 0));
    }
  }
  Client client(options.dir + "/lab.toml");
  client.next();
  lab.stop();
  std::optional<Block> last, block;
  while ((block = client.read())) last = block;
  CHECK(last->kind == 3);
  CHECK(last->payload.empty());
}

TEST_CASE("the simulated bridge reports tags lost by a slow client in the next block header") {
  const Folder dir;
  sim::LabOptions options = options_in(dir, {"person", 5, 0});
  // 4e6 tags per second (64 MB/s) exceed the capacity of the queue and the socket.
  options.window_s = 0.05;
  LabThread lab(options);
  Client client(options.dir + "/lab.toml");
  client.next();
  std::this_thread::sleep_for(std::chrono::milliseconds(800));
  std::uint64_t dropped = 0;
  std::int64_t gap_ps = 0, last_ps = 0;
  for (std::uint32_t sequence = 1; gap_ps == 0; ++sequence) {
    const Block block = client.next();
    REQUIRE(block.sequence == sequence);
    dropped += block.dropped;
    if (block.kind == 0) continue;
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
