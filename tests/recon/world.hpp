// SPDX-License-Identifier: MIT
// Functions that the tests of recon share. Most tests use a_run(). Its few bins and coarse plates
// let training take a fraction of a second.
#pragma once
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "../catch.hpp"
#include "../fixtures/damage.hpp"
#include "../fixtures/dataset.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/made.hpp"
#include "../fixtures/run.hpp"
#include "../fixtures/shell.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/fused_record.hpp"
#include "drivers/core/random.hpp"
#include "recon/predict/trained_model.hpp"

namespace echofuse::test {

// Calls `body`. Returns the message of the Error thrown by `body`, or "no error" if it does not
// throw.
inline std::string error_of(const std::function<void()>& body) {
  try {
    body();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

// Returns the data of a_run(count).
inline recon::Dataset load_plates(std::int64_t count) { return recon::load({made_run(count)}); }

// Returns a cached model of a_run(records).
inline recon::TrainedModel trained_model(const std::string& kind, std::int64_t records,
                                         Words words = {}) {
  words.insert(words.begin(), {"--set", "fallback=false"});
  return recon::load_model(made_model(kind, records, 1, words));
}

// Returns a cached default run: `kind` is one_pixel or nine_zones.
inline std::string made_default_run(const std::string& kind, const char* records,
                                    const char* seed) {
  return made("fixture", {"run", "--kind", kind, "--records", records, "--seed", seed});
}

// Returns a cached model of 300 records of a default run.
inline std::string made_default_model(const std::string& kind, const std::string& inputs) {
  return made("echofuse-recon",
              {"train", "-q", "--model", "factorised-4", "--epochs", "30", "--inputs", inputs,
               "--set", "fallback=false", made_default_run(kind, "300", "1")});
}

inline bool all_finite(std::span<const float> values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

inline Outcome recon_program(const std::string& arguments) {
  return shell(bin_dir + "/echofuse-recon " + arguments);
}

// Runs echofuse-recon and checks its exit code and error message. The message must be a single
// line, or at most three lines (including the usage) if the code is 2.
inline void refuses(const std::string& arguments, int code, const std::string& saying) {
  const Outcome o = recon_program(arguments);
  CAPTURE(arguments);
  CHECK(o.code == code);
  CHECK_THAT(o.text, Catch::Contains(saying));
  CHECK(std::count(o.text.begin(), o.text.end(), '\n') <= (code == 2 ? 3 : 1));
}

// Starts echofuse-recon without waiting for it to exit.
inline pid_t start_recon(std::vector<std::string> words) {
  words.insert(words.begin(), "echofuse-recon");
  std::vector<char*> arguments;
  for (auto& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    execv((echofuse::test::bin_dir + "/echofuse-recon").c_str(), arguments.data());
    _exit(127);
  }
  return child;
}

// Sends SIGINT to a program and returns its exit code.
inline int interrupted_code(pid_t child) {
  kill(child, SIGINT);
  int status = 0;
  waitpid(child, &status, 0);
  REQUIRE(WIFEXITED(status));
  return WEXITSTATUS(status);
}

}  // namespace echofuse::test
