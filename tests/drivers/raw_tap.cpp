// SPDX-License-Identifier: MIT
#include "drivers/port/raw_tap.hpp"

#include "../fixtures/folder.hpp"
#include "drivers/bridge/bridge_writer.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "drivers/util/exit_code.hpp"
#include "hex.hpp"

using namespace echofuse::port;
namespace fs = std::filesystem;

namespace {

struct Folder : test::Folder {
  const std::string raw = *this / "raw";
  std::string read(const std::string& name) const { return test::contents(raw + "/" + name); }
};

std::unique_ptr<Worker> thread() { return SystemLoop().make_worker(); }

// Port that delivers the bytes "hello" as soon as it is opened.
struct Speaker final : BytePort {
  void open(PortHandlers handlers) override { handlers.bytes(test::view_of("hello")); }
  void write(ByteView bytes) override { written.assign(bytes.begin(), bytes.end()); }
  Bytes written;
};
std::unique_ptr<Speaker> speaker() { return std::make_unique<Speaker>(); }

}  // namespace

TEST_CASE("raw capture writes one file per connection and creates the file at the first byte") {
  const Folder folder;
  RawKeeper keeper(folder.raw, thread());
  std::string heard;
  const PortHandlers handlers{[] {}, [&](ByteView b) { heard.append(b.begin(), b.end()); },
                              [](const Failure&) {}};
  VirtualLoop loop;
  const ByteOpener opener = tap(loop, speaker, &keeper, "tags", ".blocks");
  const auto silent = opener();  // opener of a port that is never opened
  for (int i = 0; i < 20; ++i) opener()->open(handlers);
  const RawKeeper::Counts counts = keeper.finish();
  std::string times;
  for (int i = 0; i < 20; ++i) times += "1000000000 open 0\n1000000000 bytes 5\n";
  CHECK(folder.read("tags.times") == times);
  CHECK(counts.kept == 100 + times.size());
  CHECK(counts.dropped == 0);
  CHECK(keeper.take_trouble().empty());
  CHECK(heard.size() == 100);
  CHECK(folder.read("tags-001.blocks") == "hello");
  CHECK(folder.read("tags-020.blocks") == "hello");
  CHECK(std::distance(fs::directory_iterator(folder.raw), {}) == 21);
  keeper.put("tags-020.blocks", test::view_of("late"));
  CHECK(keeper.finish().dropped == 4);
}

TEST_CASE("if raw capture is off, data pass through the original port unchanged") {
  VirtualLoop loop;
  const auto port = tap(loop, speaker, nullptr, "x", ".y")();
  port->write(test::view_of("w"));
  CHECK(dynamic_cast<Speaker&>(*port).written == Bytes{'w'});
}

TEST_CASE("raw capture drops and counts bytes beyond its queue limit or while the disk hangs") {
  struct Stalled final : Worker {
    void put(Action /*job*/) override {}
  };
  const bool stalled = GENERATE(false, true);
  const Folder folder;
  RawKeeper keeper(folder.raw, stalled ? std::make_unique<Stalled>() : thread(),
                   {.queue_bytes = 10, .reserve_bytes = 0});
  keeper.put("a", Bytes(11));
  keeper.put("a", Bytes(10));
  const auto counts = keeper.finish();
  CHECK(counts.dropped == (stalled ? 21 : 11));
  CHECK(counts.kept == (stalled ? 0 : 10));
}

TEST_CASE("raw capture ends at the first write failure and reports the failure once") {
  const auto [reserve_bytes, why] = GENERATE(table<std::uint64_t, std::string>(
      {{0, "No such file or directory"}, {UINT64_MAX, "(reserved for the run)"}}));
  const Folder folder;
  RawKeeper keeper(folder.raw, thread(), {.reserve_bytes = reserve_bytes});
  if (reserve_bytes == 0) fs::remove(folder.raw);
  keeper.put("a", Bytes(5));
  std::string trouble;
  for (int i = 0; i < 2000 && trouble.empty(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    trouble = keeper.take_trouble();
  }
  CHECK_THAT(trouble,
             Catch::Contains(why) && Catch::EndsWith("raw capture stopped, the run continues"));
  CHECK(keeper.take_trouble().empty());
  keeper.put("a", Bytes(6));
  CHECK(keeper.finish().dropped == 11);
}

TEST_CASE("raw capture refuses a folder that is not empty") {
  const Folder folder;
  fs::create_directories(folder.raw);
  std::ofstream(fs::path(folder.raw) / "x") << "y";
  CHECK_THROWS_WITH(RawKeeper(folder.raw, thread()), Catch::Contains("is not empty"));
  CHECK_THROWS_AS(RawKeeper((fs::path(folder.raw) / "x").string(), thread()), Error);
}

TEST_CASE("camera blocks stored by raw capture match the bridge protocol") {
  using namespace echofuse::bridge;
  const auto golden = test::read_golden("bridge.hex");
  const auto payload = [&](std::size_t i) { return ByteView(golden[i]).subspan(header_bytes); };
  for (std::uint32_t i = 0; i < golden.size(); ++i)
    CHECK(make_block(static_cast<BlockKind>(i), i, i == 2 ? 5 : 0, payload(i)) == golden[i]);
  const DepthPayload read = *read_depth(payload(2));
  CHECK(std::ranges::equal(depth_payload(read.frame, read.x, read.y), payload(2)));
  DeviceInfo info;
  info.model = "m \xff", info.serial = "s", info.firmware = "f";
  const Hello hello = *read_hello(hello_payload(info));
  CHECK(hello.model + ", " + hello.serial + ", " + hello.firmware == "m \ufffd, s, f");
}
