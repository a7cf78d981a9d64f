// SPDX-License-Identifier: MIT
#include <cstdlib>
#include <initializer_list>

#include "recon/numbers/blas.hpp"

// An OpenBLAS with run-time dispatch exports these functions, which are not an official interface.
// If they are missing, OpenBLAS selects the kernels itself.
extern "C" {
char* openblas_get_corename() __attribute__((weak));
void gotoblas_dynamic_quit() __attribute__((weak));
void gotoblas_dynamic_init() __attribute__((weak));
}

namespace echofuse::recon {
namespace {

bool is_one_of(const std::string& core, std::initializer_list<const char*> names) {
  for (const char* name : names)
    if (core == name) return true;
  return false;
}

bool is_avx512(const std::string& core) {
  return is_one_of(core, {"SkylakeX", "Cooperlake", "SapphireRapids"});
}
bool is_avx2(const std::string& core) { return is_one_of(core, {"Haswell", "Zen", "Excavator"}); }

// Returns the name of the kernels that OpenBLAS should use instead of `core`, or null if there are
// no faster ones. The names are those in driver/others/dynamic.c of OpenBLAS.
const char* better_than(const std::string& core) {
  if (is_avx512(core)) return nullptr;
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
    return "SkylakeX";
  if (is_avx2(core)) return nullptr;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return "Haswell";
  return nullptr;
}

std::string choose() {
  if (!openblas_get_corename || !gotoblas_dynamic_quit || !gotoblas_dynamic_init) return "BLAS";
  if (!std::getenv("OPENBLAS_CORETYPE")) {
    if (const char* core = better_than(openblas_get_corename())) {
      // OpenBLAS allows a choice of kernels only through this environment variable. The variable is
      // removed afterwards, so that child processes make their own choice.
      ::setenv("OPENBLAS_CORETYPE", core, 1);
      gotoblas_dynamic_quit();
      gotoblas_dynamic_init();
      ::unsetenv("OPENBLAS_CORETYPE");
    }
  }
  return openblas_get_corename();
}

}  // namespace

const std::string& blas_kernels() {
  static const std::string chosen = choose();
  return chosen;
}

std::string blas_instructions() {
  const std::string& core = blas_kernels();
  if (core == "BLAS") return "unknown";
  if (is_avx512(core)) return "AVX-512";
  if (is_avx2(core)) return "AVX2";
  return is_one_of(core, {"Sandybridge", "Bulldozer", "Piledriver", "Steamroller"}) ? "AVX" : "SSE";
}

}  // namespace echofuse::recon
