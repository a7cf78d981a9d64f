// SPDX-License-Identifier: MIT
#include "recon/models/blas.hpp"

#include <cblas.h>

#include <algorithm>
#include <thread>

// Only OpenBLAS has it; with another BLAS the call is left out.
extern "C" void openblas_set_num_threads(int) __attribute__((weak));

namespace echofuse::recon {
namespace {

struct Shape {
  CBLAS_TRANSPOSE a, b;
  int m, n, k, lda, ldb, ldc;
};

template <class T>
Shape shape(const Product<T>& p) {
  const bool ta = p.a_transposed == Transpose::yes, tb = p.b_transposed == Transpose::yes;
  const int m = static_cast<int>(p.m), n = static_cast<int>(p.n), k = static_cast<int>(p.k);
  return {ta ? CblasTrans : CblasNoTrans,
          tb ? CblasTrans : CblasNoTrans,
          m,
          n,
          k,
          ta ? m : k,
          tb ? k : n,
          n};
}

}  // namespace

void multiply(const Product<float>& p, const float* a, const float* b, float* c) {
  const Shape s = shape(p);
  cblas_sgemm(CblasRowMajor, s.a, s.b, s.m, s.n, s.k, p.alpha, a, s.lda, b, s.ldb, p.beta, c,
              s.ldc);
}

void multiply(const Product<double>& p, const double* a, const double* b, double* c) {
  const Shape s = shape(p);
  cblas_dgemm(CblasRowMajor, s.a, s.b, s.m, s.n, s.k, p.alpha, a, s.lda, b, s.ldb, p.beta, c,
              s.ldc);
}

void set_threads(int count) {
  if (count <= 0) count = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  if (openblas_set_num_threads) openblas_set_num_threads(count);
}

}  // namespace echofuse::recon
