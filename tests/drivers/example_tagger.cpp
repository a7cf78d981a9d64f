// SPDX-License-Identifier: MIT
#include "drivers/examples/example_tagger.hpp"

#include "../catch.hpp"
#include "sink.hpp"

TEST_CASE("the example tagger driver delivers tags, counts losses and reconnects") {
  int opened = 0, reads = 0;
  const examples::VendorBoard board{
      .open = [&] { return ++opened > 1; },  // the device is attached on the second attempt
      .read =
          [&](std::vector<Tag>& tags, std::uint64_t& lost) {
            ++reads;
            tags.push_back({.channel = 1, .time_ps = 1000 * reads});
            lost = reads == 2 ? 7 : 0;
            return reads != 3;  // the device is unplugged on the third read
          }};
  port::SystemLoop loop;
  test::KeepingSink sink;
  examples::ExampleTagger driver(loop, board, "example:");
  driver.start(sink);
  REQUIRE(test::run_until(loop, [&] { return sink.tags.size() == 4; }));
  driver.stop();
  using enum DeviceState;
  CHECK(sink.states == std::vector{connecting, streaming, faulted, streaming});
  CHECK(sink.tags[1].time_ps == 2000);
  CHECK(sink.blocks[1].lost_items == 7);
  CHECK(sink.events.size() == 1);
  CHECK(test::counter(driver, "items") == 4);
  CHECK(test::counter(driver, "lost") == 7);
  CHECK(test::counter(driver, "reconnects") == 1);
  const auto stopped_at = sink.tags.size();
  loop.run_for(std::chrono::milliseconds(50));
  CHECK(sink.tags.size() == stopped_at);
}
