// SPDX-License-Identifier: MIT
// Tests the command line of echofuse-sim: exit codes, error texts and output.
#include <sys/stat.h>

#include "../fixtures/folder.hpp"
#include "../fixtures/shell.hpp"
#include "acquire/record/run_reader.hpp"

namespace {

namespace fs = std::filesystem;

using echofuse::test::Folder, echofuse::test::has, echofuse::test::Outcome;

Outcome sim(const std::string& arguments) {
  return echofuse::test::shell(echofuse::test::bin_dir + "/echofuse-sim " + arguments);
}

void refuses(const std::string& arguments, int code, const std::string& saying) {
  const Outcome o = sim("dataset " + arguments);
  CAPTURE(arguments, o.text);
  CHECK(o.code == code);
  CHECK(has(o.text, saying));
}

}  // namespace

TEST_CASE("echofuse-sim refuses a FIFO given as an input file without blocking") {
  const Folder folder;
  const std::string fifo = folder / "f.obj", why = "f.obj: is a FIFO; expected a regular file";
  REQUIRE(::mkfifo(fifo.c_str(), 0666) == 0);
  const std::string out = "--out " + folder / "a.sqlite" + " ";
  for (const std::string& options :
       {"--records 1 --objects 1 --set object=" + fifo, "--config " + fifo, "--set twin=" + fifo,
        "--records 1 --part 1/2 --set object=" + fifo, "--set scenes=" + fifo})
    refuses(out + options, 3, why);
  for (const char* option : {" --faults ", " --radar-cfg "}) {
    const Outcome o = sim("lab --dir " + folder / "lab" + option + fifo + " -- true");
    CAPTURE(o.text);
    CHECK(o.code == 3);
    CHECK(has(o.text, why));
  }
}

TEST_CASE("echofuse-sim lab returns the exit code of the command that it runs") {
  const Folder folder;
  CHECK(sim("lab --dir " + folder / "lab" + " -- sh -c 'exit 7'").code == 7);
  const Outcome o = sim("lab --dir " + folder / "lab" + " -- no-such-program");
  CHECK(o.code == 1);
  CHECK(has(o.text, "no-such-program: cannot start"));
}

TEST_CASE("the option --set accepts scene lists and object files") {
  const Folder folder;
  std::ofstream(folder / "list.toml") << "[[scene]]\nkind = \"object\"\ncount = 2\n";
  std::ofstream(folder / "plate.obj") << "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  const std::string list = " --set scenes=" + folder / "list.toml";
  const std::string object = " --set object=" + folder / "plate.obj";
  const std::string out = "--out " + folder / "x.sqlite";
  refuses(out + list, 3, "object = \"FILE.obj\"");
  refuses(out + list + object + " --people 3", 2, "remove the record counts");
  refuses(out + " --objects 1 --set object=" + folder / "no.obj", 3, "no.obj: cannot read");
  CHECK_FALSE(fs::exists(folder / "x.sqlite"));
  const Outcome o = sim("dataset " + out + list + object);
  CAPTURE(o.text);
  CHECK(o.code == 0);
  CHECK(has(o.text, ": 2 records in "));
  const Outcome lab = sim("lab --scene object --dir " + folder / "lab");
  CHECK(lab.code == 3);
  CHECK(has(lab.text, "object = \"FILE.obj\""));
}

TEST_CASE("other options override --set, and --set overrides the configuration file") {
  const Folder folder;
  std::ofstream(folder / "sim.toml") << "people = 3\nletters = 0\nseed = 5\nbins = 100\n";
  const Outcome o = sim("dataset --out " + folder / "a.sqlite" + " --config " +
                        folder / "sim.toml" + " --set people=2 --set seed=6 --seed 7");
  CAPTURE(o.text);
  CHECK(o.code == 0);
  CHECK(has(o.text, "a.sqlite: 2 records in "));
  const std::string settings =
      echofuse::record::RunReader(folder / "a.sqlite").info().config_resolved;
  CHECK(has(settings, "seed = 7\n"));
  CHECK(has(settings, "bins = 100\n"));
}

TEST_CASE("echofuse-sim config --json prints every setting") {
  const Outcome o = sim("config --json --set bins=100 --set 'scenes=a\"b\\c'");
  CAPTURE(o.text);
  CHECK(o.code == 0);
  for (const char* part :
       {"{\"schema\": 1, \"settings\": {\n  \"",
        "\"bins\": {\"value\": 100, \"min\": 1, \"max\": 65536, \"help\": \"number of bins",
        "\"radar_step_m\": {\"value\": 0.25, \"min\": 0.001, \"max\": 10, ",
        "\"radar_array_calibrated\": {\"value\": true, \"help\": ",
        "\"scenes\": {\"value\": \"a\\\"b\\\\c\", \"help\": ",
        "{\"value\": \"sinc\", \"allowed\": [\"sinc\", \"hann\", \"hamming\", \"blackman\"], "
        "\"help\": "})
    CHECK(has(o.text, part));
  CHECK(sim("config --json | grep -c '\"value\":'").text ==
        sim("config | grep -c '^[a-z_]* = '").text);
}
