// SPDX-License-Identifier: MIT
// The tests of BLAS kernels are a separate program, because a process selects its kernels only
// once, before its first matrix product.

#include "../fixtures/shell.hpp"
#include "recon/numbers/blas.hpp"

using namespace echofuse::recon;

extern "C" {
char* openblas_get_corename() __attribute__((weak));
void gotoblas_dynamic_quit() __attribute__((weak));
void gotoblas_dynamic_init() __attribute__((weak));
}

namespace {

bool avx2() { return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"); }
bool avx512() {
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
}

// Makes OpenBLAS use the kernel for unknown processors. Returns false if this build of OpenBLAS
// cannot switch kernels.
bool forget_processor() {
  if (!openblas_get_corename || !gotoblas_dynamic_quit || !gotoblas_dynamic_init) return false;
  setenv("OPENBLAS_CORETYPE", "Prescott", 1);
  gotoblas_dynamic_quit();
  gotoblas_dynamic_init();
  unsetenv("OPENBLAS_CORETYPE");
  return std::string(openblas_get_corename()) == "Prescott";
}

std::string version_with(const std::string& environment) {
  const auto done = echofuse::test::shell("env " + environment + " " + echofuse::test::bin_dir +
                                          "/echofuse-recon --version");
  REQUIRE(done.code == 0);
  return done.text;
}

}  // namespace

TEST_CASE("BLAS kernels for an unknown processor are selected by its CPU features") {
  const bool dispatched = forget_processor();
  const std::string kernels = blas_kernels();
  CAPTURE(kernels);
  if (dispatched && avx512())
    CHECK(kernels == "SkylakeX");
  else if (dispatched && avx2())
    CHECK(kernels == "Haswell");
  CHECK(std::getenv("OPENBLAS_CORETYPE") == nullptr);
  const float a[] = {1, 2, 3, 4}, b[] = {5, 6, 7, 8};
  float c[4] = {};
  multiply(Product<float>{.m = 2, .n = 2, .k = 2}, a, b, c);
  CHECK(std::vector<float>(c, c + 4) == std::vector<float>{19, 22, 43, 50});
}

TEST_CASE("the version option prints the BLAS kernels, and a variable overrides them") {
  const std::string own = version_with("-u OPENBLAS_CORETYPE");
  CHECK_THAT(own, Catch::Contains("matrix kernels "));
  if (avx2()) CHECK_THAT(own, !Catch::Contains("SSE"));
  if (openblas_get_corename)
    CHECK_THAT(version_with("OPENBLAS_CORETYPE=Prescott"), Catch::Contains("Prescott (SSE)"));
}
