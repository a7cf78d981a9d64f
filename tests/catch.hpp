// SPDX-License-Identifier: MIT
// Includes Catch2, version 2.13 or 3. Defines in version 3 the names of version 2 that the tests
// use. Includes the parts of the standard library that many tests use, and opens the namespace of
// the project for all tests.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#if __has_include(<catch2/catch_all.hpp>)
#include <catch2/catch_all.hpp>

using Catch::Approx;
namespace Catch {
using Matchers::EndsWith;
using Matchers::Equals;
using Matchers::Matches;
using Matchers::StartsWith;
inline auto Contains(const std::string& text) { return Matchers::ContainsSubstring(text); }
using TestEventListenerBase = EventListenerBase;
}  // namespace Catch
#else
#include <catch2/catch.hpp>
#endif

namespace echofuse::test {

// Runs the test cases selected by the arguments. Returns the number of failed test cases as the
// exit code.
int run_catch(int argc, char** argv);

}  // namespace echofuse::test

using namespace echofuse;
