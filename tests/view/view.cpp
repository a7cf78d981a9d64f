// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>

#include "../fixtures/folder.hpp"
#include "../fixtures/run.hpp"
#include "recon/live/access.hpp"
#include "recon/live/followed_run.hpp"
#include "recon/live/message.hpp"
#include "recon/live/run_messages.hpp"

using namespace echofuse::view;

namespace {

nlohmann::json header_of(const Message& message) {
  ByteReader reader(*message);
  const ByteView text = reader.take(reader.get<std::uint32_t>());
  return nlohmann::json::parse(text.begin(), text.end());
}

}  // namespace

TEST_CASE("on the loopback interface the server refuses Host names of DNS rebinding") {
  const Access here;
  for (const char* host : {"localhost", "LocalHost:8410", "127.0.0.1", "127.0.0.1:1", "[::1]:8410"})
    CHECK(here.accepts_host(host));
  for (const char* host :
       {"", ":8410", "evil.example", "127.0.0.1.evil.example", "localhost.evil", "10.0.0.1", "lab7",
        "127.0.0.1:", "127.0.0.1:port", "[::1", "127.1", "[]", "127.100.100.100.evil"})
    CHECK_FALSE(here.accepts_host(host));
  Access all;
  all.loopback = false;  // reading needs the token
  for (const char* host :
       {"localhost:8410", "10.0.0.1:8410", "lab7:8410", "vm.local", "[fe80::1]:8410"})
    CHECK(all.accepts_host(host));
  for (const char* host : {"", ":8410", "lab7:port", "[::1"}) CHECK_FALSE(all.accepts_host(host));
}

TEST_CASE("a web page from another origin cannot open a WebSocket") {
  const Access access;
  const std::string here = "127.0.0.1:8410";
  for (const std::string& origin : {std::string(), "http://" + here, "https://" + here})
    CHECK(access.accepts_origin(origin, here));
  for (const char* origin : {"null", "http://127.0.0.1", "http://127.0.0.1:8411", "file://",
                             "http://evil.example", "http://127.0.0.1:8410.evil.example"})
    CHECK_FALSE(access.accepts_origin(origin, here));
}

TEST_CASE("the access token is required for reading on a public address and always for writing") {
  Access access;
  access.token = make_token();
  CHECK(access.token.size() == 32);
  CHECK(make_token() != access.token);
  CHECK(access.may_read(""));
  CHECK_FALSE(access.may_write(""));
  CHECK_FALSE(access.may_write(access.token.substr(1)));
  CHECK(access.may_write(access.token));
  for (std::size_t i = 0; i < access.token.size(); ++i) {
    std::string other = access.token;
    other[i] = other[i] == '0' ? '1' : '0';
    CHECK_FALSE(access.may_write(other));
  }
  access.needs_token = true;
  CHECK_FALSE(access.may_read("0"));
  CHECK(access.may_read(access.token));
  // If the server has no token, an empty token does not permit writing.
  CHECK_FALSE(Access{}.may_write(""));
  CHECK(target_of("/live?a=1&token=12&b").token == "12");
  CHECK(target_of("/live?xtoken=12").token.empty());
  CHECK(target_of("/live").path == "/live");
  CHECK(target_of("?").path.empty());
}

TEST_CASE("a live message has a header, and its arrays begin at multiples of 8 bytes") {
  MessageWriter writer;
  writer.add("a", std::vector<std::uint32_t>{1, 2, 3});
  writer.add<float>("b", std::vector<float>{0.5F, 1}, {1, 2});
  const Message message = writer.finish({{"kind", "test"}, {"text", "\xff"}});
  const auto header = header_of(message);
  CHECK(header["kind"] == "test");
  CHECK(header["arrays"]["b"]["offset"] == 16);
  CHECK(header["arrays"]["b"]["shape"] == nlohmann::json{1, 2});
  const std::size_t begin = (4 + ByteReader(*message).get<std::uint32_t>() + 7) / 8 * 8;
  REQUIRE(message->size() == begin + 24);
  ByteReader arrays(ByteView(*message).subspan(begin));
  CHECK(arrays.get<std::uint32_t>() == 1);
  arrays.take(12);
  CHECK(arrays.get<float>() == 0.5F);
}

TEST_CASE("the viewer parses each kind of request and refuses values beyond the limits") {
  const auto refusal = [](const std::string& text) {
    const Request request = parse_request(text);
    const auto* bad = std::get_if<BadRequest>(&request);
    return bad ? bad->why : "";
  };
  CHECK(std::holds_alternative<ShowLive>(parse_request(R"({"show": "live"})")));
  CHECK(std::get<ShowRecord>(parse_request(R"({"show": 17})")).index == 17);
  const auto sheet = std::get<ShowSheet>(parse_request(R"({"sheet": [3, 3]})"));
  CHECK((sheet.first == 3 && sheet.last == 3));
  const auto sum = std::get<ShowSum>(parse_request(R"({"sum": [1000, 2.5, 4]})"));
  CHECK((sum.records == 1000 && sum.range.from_m == 2.5 && sum.range.to_m == 4));
  const auto mark = std::get<Mark>(parse_request(R"({"mark": "door opened"})"));
  CHECK_FALSE(mark.label);
  CHECK(mark.text == "door opened");
  const std::string longest(200, 'x');
  CHECK(std::get<Mark>(parse_request(R"({"label": ")" + longest + "\"}")).label);
  CHECK(refusal(R"({"label": ""})").empty());
  CHECK(refusal(R"({"mark": ""})").starts_with("text too long or empty"));
  CHECK(refusal(R"({"mark": "x)" + longest + "\"}").starts_with("text too long or empty"));
  CHECK(refusal(R"({"mark": "two\nlines"})") == "expected one line of printable text");
  CHECK(refusal(R"({"label": 3})") == "mark and label: expected a string");
  for (const char* text : {R"({"sum": [1001, 2, 4]})", R"({"sum": [1, 2]})",
                           R"({"sum": [1, "2", 4]})", R"({"sum": [-1, 2, 4]})"})
    CHECK(refusal(text) ==
          "sum: expected [number of records (0 to 1000), fit range start (m), fit range end (m)]");
  for (const char* text : {R"({"show": -1})", R"({"show": 1.5})", R"({"show": "old"})",
                           R"({"sheet": [4, 3]})", R"({"sheet": [1, 2, 3]})", R"({"hide": 1})"})
    CHECK(refusal(text) == "unknown request: expected show, sheet, sum, mark or label");
  for (const char* text : {"", "[]", "17", R"({"show": 1, "mark": "x"})", R"({"show": )",
                           R"({"show": [[[[[[[[[[]]]]]]]]]]})"})
    CHECK(refusal(text) == "expected a JSON object with one key");
  CHECK(refusal(std::string(1025, ' ')) == "request too long (limit 1024 bytes)");
}

TEST_CASE("a sensor is reported as stale two slots after its last valid slot") {
  SensorState sensor;
  const UtcTime now = std::chrono::seconds(100);
  CHECK(is_stale(sensor, 3, now));
  sensor.last_valid = now - std::chrono::milliseconds(6400);
  CHECK_FALSE(is_stale(sensor, 3, now));
  sensor.last_valid = now - std::chrono::milliseconds(6600);
  CHECK(is_stale(sensor, 3, now));
  // The last valid data appear to be in the future because the system clock was set back.
  sensor.last_valid = now + std::chrono::seconds(1);
  CHECK(age_s(sensor, now) == 0);
}

TEST_CASE("the viewer reads and sends a run again if the run was temporarily unreadable") {
  const test::Folder folder;
  const std::string path = folder / "run.sqlite";
  test::a_small_run(0).write(path);
  const auto time = std::filesystem::last_write_time(path) + std::chrono::seconds(1);
  // Modifies the file but leaves its size and modification time unchanged.
  const auto write_first_byte = [&](char byte) {
    std::fstream(path, std::ios::in | std::ios::out | std::ios::binary).put(byte);
    std::filesystem::last_write_time(path, time);
  };
  FollowedRun run(path);
  CHECK(run.refresh());
  CHECK(run.trouble().empty());
  CHECK_FALSE(run.refresh());
  const int edition = run.edition();

  write_first_byte('X');
  CHECK(run.refresh());
  CHECK_FALSE(run.trouble().empty());
  // A problem that persists is reported only once.
  CHECK_FALSE(run.refresh());
  write_first_byte('S');
  CHECK(run.refresh());
  CHECK(run.trouble().empty());
  CHECK(run.edition() != edition);
}

TEST_CASE("the viewer state contains the time until the disk is full") {
  const test::Folder folder;
  record::RunInfo info;
  info.window_s = 3;
  test::a_small_run(4).info(info).write(folder / "run.sqlite");
  FollowedRun run(folder / "run.sqlite");
  run.refresh();
  const auto disk = header_of(RunMessages(run, nullptr, {}, system_clock).state())["disk"];
  const double free_bytes = disk["free_bytes"], bytes = static_cast<double>(run.bytes());
  CHECK(disk["lasts_s"].get<double>() == Approx(free_bytes / (bytes / 4) * 3));
}

TEST_CASE("the run summary lists doubtful verdicts by sensor, with the most frequent first") {
  using enum record::VerdictKind;
  record::VerdictCounts all;
  CHECK(all.doubts().empty());
  all.records = 75, all.doubtful = 28;
  all.by_sensor[Sensor::spd] = {{ok, 75}};
  all.by_sensor[Sensor::radar] = {{missing, 10}, {ok, 54}, {weak, 11}, {not_assessed, 3}};
  all.by_sensor[Sensor::depth] = {{stands_still, 7}, {not_configured, 68}};
  CHECK(all.doubts() == "28 of 75 doubtful: radar weak 11, missing 10; camera stands still 7");
}
