// SPDX-License-Identifier: MIT
// Tests how device locks affect other programs.
#include "acquire/devices/device_locks.hpp"

#include "../fixtures/error.hpp"
#include "../fixtures/folder.hpp"

using namespace echofuse::acquire;
namespace fs = std::filesystem;

namespace {

// Folder for device locks that only this test uses.
struct Locks : test::Folder {
  Locks() : before(lock_folder()) { ::setenv("ECHOFUSE_LOCKS", path.c_str(), 1); }
  ~Locks() { ::setenv("ECHOFUSE_LOCKS", before.c_str(), 1); }
  std::string before;
};

Config tagger_at(const std::string& address) {
  Config config;
  config.tdc.address = address;
  return config;
}

}  // namespace

TEST_CASE("a device lock names its holder and is released when the holder exits") {
  const Locks locks;
  const Config config = tagger_at("bridge:tcp://h:1");
  const std::string run = "/data/a b\n.sqlite";
  {
    const DeviceLocks held(config, "run", run);
    CHECK_FALSE(held.other(Sensor::spd));
    for (int i = 0; i < 3; ++i) {
      const auto other = DeviceLocks(config, "devices").other(Sensor::spd).value();
      CHECK_THAT(other.who, Catch::StartsWith("echofuse-acquire run, pid ") &&
                                Catch::EndsWith(", run /data/a b\\n.sqlite"));
      CHECK(other.run == run);
    }
    held.write("run", "/data/next.sqlite");
    CHECK(DeviceLocks(config, "devices").other(Sensor::spd)->run == "/data/next.sqlite");
    CHECK_FALSE(DeviceLocks(tagger_at("bridge:tcp://h:2"), "run").other(Sensor::spd));
  }
  CHECK(fs::is_empty(locks / lock_name(config.tdc.address)));
  const DeviceLocks again(config, "devices");
  CHECK_FALSE(again.other(Sensor::spd));
  CHECK(DeviceLocks(config, "run").other(Sensor::spd)->run.empty());
  const Config other = tagger_at("bridge:tcp://h:3");
  std::ofstream(locks / lock_name(other.tdc.address)) << "precious";
  const std::string text = test::check_error(ExitCode::device, "is not an echofuse lock file",
                                             [&] { DeviceLocks(other, "run"); });
  CHECK_THAT(text, Catch::StartsWith("the device lock "));
}

TEST_CASE("the file name of a device lock depends on the device address") {
  const test::Folder folder;
  std::ofstream(folder / "record.oni") << "";
  CHECK_THAT(lock_name("serial:/dev/ttyUSB0"), Catch::StartsWith("echofuse-serial-"));
  CHECK(lock_name("serial:/dev/../dev/ttyUSB0") == lock_name("serial:/dev/ttyUSB0"));
  CHECK(lock_name("serial:/dev/ttyUSB1") != lock_name("serial:/dev/ttyUSB0"));
  CHECK(lock_name("bridge:tcp://h:1") != lock_name("bridge:tcp://h:2"));
  CHECK(lock_name("bridge:tcp://localhost:1") == lock_name("bridge:tcp://127.0.0.1:1"));
  CHECK(lock_name("openni:" + (folder / "record.oni")).empty());
}
