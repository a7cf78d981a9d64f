// SPDX-License-Identifier: MIT
// A training that is stopped, killed, taken up again, or done by more threads ends in the same
// bits.
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <iterator>
#include <sstream>
#include <thread>

#include "recon/estimator/train.hpp"
#include "recon/numbers/parallel.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using echofuse::testing::Folder;
using echofuse::testing::Outcome;
using echofuse::testing::recon_program;
using echofuse::testing::start_recon;
using echofuse::testing::write_run;

namespace {

ino_t inode(const std::string& path) {
  struct stat s {};
  return ::stat(path.c_str(), &s) == 0 ? s.st_ino : 0;
}

// Trains until the checkpoint is another file than before, then sends the signal.
int stopped_by(int signal, std::vector<std::string> words, const std::string& checkpoint) {
  const ino_t before = inode(checkpoint);
  const pid_t child = start_recon(std::move(words));
  int status = 0;
  while (inode(checkpoint) == before) {
    REQUIRE(waitpid(child, &status, WNOHANG) == 0);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  kill(child, signal);
  REQUIRE(waitpid(child, &status, 0) == child);
  return status;
}

void check_same(const TrainedModel& a, const TrainedModel& b, const Dataset& data) {
  CHECK(a.log.loss == b.log.loss);
  CHECK(a.log.validation_loss == b.log.validation_loss);
  CHECK(a.log.best_epoch == b.log.best_epoch);
  CHECK(a.predict(data, {0, 1, 50}).values == b.predict(data, {0, 1, 50}).values);
}

}  // namespace

TEST_CASE("a training that was killed, resumed, stopped and resumed is the one never touched") {
  const Folder dir;
  write_run(dir / "run", 150);
  const std::string options = " --hidden 256,128 --epochs 40 --batch 16 --checkpoint-s 0.05 -q";
  std::vector<std::string> words = {"train", dir / "run", "--out", dir / "m"};
  std::istringstream more(options);
  words.insert(words.end(), std::istream_iterator<std::string>(more), {});
  auto resuming = words;
  resuming.push_back("--resume");
  const std::string checkpoint = dir / "m.checkpoint";

  const int killed = stopped_by(SIGKILL, words, checkpoint);
  REQUIRE(WIFSIGNALED(killed));
  CHECK_FALSE(std::filesystem::exists(dir / "m"));
  const int stopped = stopped_by(SIGINT, resuming, checkpoint);
  REQUIRE(WIFEXITED(stopped));
  CHECK(WEXITSTATUS(stopped) == 130);
  CHECK(load_model(dir / "m").log.loss.size() < 40);  // the best so far
  REQUIRE(std::filesystem::exists(checkpoint));

  const std::string command = "train " + (dir / "run") + " --out " + (dir / "m") + " --resume";
  const Outcome other = recon_program(command + options + " --seed 2");
  CHECK(other.code == 3);
  CHECK_THAT(other.text, Catch::Contains("--seed=1, this one has --seed=2"));
  CHECK_THAT(recon_program(command + options + " --no-fallback").text,
             Catch::Contains("this one has --no-fallback=given"));
  REQUIRE(recon_program(command + options).code == 0);
  CHECK_FALSE(std::filesystem::exists(checkpoint));
  const Outcome nothing = recon_program(command + options);
  CHECK(nothing.code == 1);
  CHECK_THAT(nothing.text, Catch::Contains("m.checkpoint: no such file"));

  REQUIRE(recon_program("train " + (dir / "run") + " --out " + (dir / "whole") + options).code ==
          0);
  CHECK_FALSE(std::filesystem::exists(dir / "whole.checkpoint"));
  check_same(load_model(dir / "m"), load_model(dir / "whole"), load({dir / "run"}));
}

TEST_CASE("one, two and three threads train the same model") {
  const Folder dir;
  write_run(dir / "run", 150);
  const Dataset data = load({dir / "run"});
  for (const std::string name : {"mlp", "ridge"}) {
    CAPTURE(name);
    TrainOptions options;
    options.model = name;
    options.fit.epochs = 3, options.fit.quiet = true;
    const auto with = [&](int threads) {
      set_threads(threads);
      return train(data, options);
    };
    const TrainedModel one = with(1);
    check_same(one, with(2), data);
    check_same(one, with(3), data);
  }
  set_threads(0);
}

TEST_CASE("every part is worked on once, whatever the number of threads") {
  for (const int threads : {1, 2, 5}) {
    set_threads(threads);
    for (const std::size_t parts : {0u, 1u, 2u, 7u, 1000u}) {
      std::vector<int> seen(parts);
      for (int i = 0; i < 50; ++i) for_each_part(parts, [&](std::size_t k) { ++seen[k]; });
      CHECK(seen == std::vector<int>(parts, 50));
    }
  }
  set_threads(0);
}

TEST_CASE("a dead sensor is refused by the record's number") {
  const Folder dir;
  write_run(dir / "good", 20);
  write_run(dir / "dead", 20, 2, [](record::FusedRecord& r) {
    if (r.index == 13) std::fill(r.spd.begin(), r.spd.end(), 4u);
  });
  const std::string command =
      "train -q --model ridge " + (dir / "good") + " " + (dir / "dead") + " --out " + (dir / "m");
  for (const std::string inputs : {"fused", "spd"}) {
    const Outcome o = recon_program(command + " --inputs " + inputs);
    CHECK(o.code == 1);
    CHECK_THAT(o.text, Catch::Contains(dir / "dead: record 13: spd is the same in every bin"));
  }
  CHECK(recon_program(command + " --inputs radar").code == 0);
}
