// SPDX-License-Identifier: MIT
#include "recon/numbers/blas.hpp"

#include <cblas.h>

#include <algorithm>
#include <cassert>
#include <vector>

#include "drivers/util/exit_code.hpp"
#include "recon/numbers/parallel.hpp"

// Only OpenBLAS exports these functions. If another BLAS is linked, the weak symbols are null.
extern "C" void openblas_set_num_threads(int) __attribute__((weak));
extern "C" int blas_thread_shutdown_() __attribute__((weak));
// LAPACK functions, which are part of OpenBLAS.
extern "C" void sgeqrf_(const int* m, const int* n, float* a, const int* lda, float* tau,
                        float* work, const int* work_size, int* info);
extern "C" void sorgqr_(const int* m, const int* n, const int* k, float* a, const int* lda,
                        const float* tau, float* work, const int* work_size, int* info);
extern "C" void dgesdd_(const char* job, const int* m, const int* n, double* a, const int* lda,
                        double* s, double* u, const int* ldu, double* vt, const int* ldvt,
                        double* work, const int* work_size, int* iwork, int* info);

namespace echofuse::recon {
namespace {

// Ends the threads of OpenBLAS, because their busy waiting costs 30 ms of CPU time per program
// start. Parallel parts run on the threads of parallel.hpp instead.
const bool one_thread = [] {
  if (openblas_set_num_threads) openblas_set_num_threads(1);
  if (blas_thread_shutdown_) blas_thread_shutdown_();
  return true;
}();

// Part of a matrix product computed by one BLAS call: `rows` x `cols` elements of C, starting at
// (row, col).
struct Strip {
  std::size_t row, col, rows, cols;
};

// Returns the parts of a matrix product: strips across the longer side of C. A small product has
// one or two strips, and a large product has at most eight, because BLAS packs the other factor
// again for each strip.
std::vector<Strip> parts_of(std::size_t m, std::size_t n, std::size_t k) {
  constexpr std::size_t small = 4'000'000, narrowest = 128, few = 2, many = 8;
  const std::size_t work = m * n * k;
  if (work < small) return {{0, 0, m, n}};
  const std::size_t side = std::max(m, n), strips = work < 8 * small ? few : many;
  const std::size_t width = std::max(narrowest, ((side + strips - 1) / strips + 63) / 64 * 64);
  std::vector<Strip> out;
  for (std::size_t first = 0; first < side; first += width) {
    const std::size_t count = std::min(width, side - first);
    out.push_back(n >= m ? Strip{0, first, m, count} : Strip{first, 0, count, n});
  }
  return out;
}

void gemm(CBLAS_TRANSPOSE ta, CBLAS_TRANSPOSE tb, int m, int n, int k, float alpha, const float* a,
          int lda, const float* b, int ldb, float beta, float* c, int ldc) {
  cblas_sgemm(CblasRowMajor, ta, tb, m, n, k, alpha, a, lda, b, ldb, beta, c, ldc);
}
void gemm(CBLAS_TRANSPOSE ta, CBLAS_TRANSPOSE tb, int m, int n, int k, double alpha,
          const double* a, int lda, const double* b, int ldb, double beta, double* c, int ldc) {
  cblas_dgemm(CblasRowMajor, ta, tb, m, n, k, alpha, a, lda, b, ldb, beta, c, ldc);
}

// Selects the kernels (see blas_kernels). Must be called before any BLAS function.
void choose_kernels() {
  static const bool chosen = one_thread && !blas_kernels().empty();
  static_cast<void>(chosen);
}

template <class T>
void multiply_parts(const Product<T>& p, const T* a, const T* b, T* c) {
  choose_kernels();
  const bool ta = p.a_transposed == Transpose::yes, tb = p.b_transposed == Transpose::yes;
  const std::size_t lda = ta ? p.m : p.k, ldb = tb ? p.k : p.n;
  const auto parts = parts_of(p.m, p.n, p.k);
  for_each_part(parts.size(), [&](std::size_t i) {
    const Strip& part = parts[i];
    gemm(ta ? CblasTrans : CblasNoTrans, tb ? CblasTrans : CblasNoTrans,
         static_cast<int>(part.rows), static_cast<int>(part.cols), static_cast<int>(p.k), p.alpha,
         a + part.row * (ta ? 1 : lda), static_cast<int>(lda), b + part.col * (tb ? ldb : 1),
         static_cast<int>(ldb), p.beta, c + part.row * p.n + part.col, static_cast<int>(p.n));
  });
}

}  // namespace

void multiply(const Product<float>& p, const float* a, const float* b, float* c) {
  multiply_parts(p, a, b, c);
}

void multiply(const Product<double>& p, const double* a, const double* b, double* c) {
  multiply_parts(p, a, b, c);
}

// LAPACK uses column-major order, so our rows are its columns.
void orthonormalise_rows(std::size_t rows, std::size_t cols, float* values) {
  constexpr std::size_t block = 64;  // block size used for the workspace, in columns
  choose_kernels();
  const int m = static_cast<int>(cols), n = static_cast<int>(rows);
  std::vector<float> scales(rows), work(rows * block);
  const int work_size = static_cast<int>(work.size());
  int info = 0;
  sgeqrf_(&m, &n, values, &m, scales.data(), work.data(), &work_size, &info);
  sorgqr_(&m, &n, &n, values, &m, scales.data(), work.data(), &work_size, &info);
  assert(info == 0);  // a nonzero value would mean a wrong argument
}

void decompose(std::size_t m, std::size_t n, double* x, double* s, double* u, double* vt) {
  choose_kernels();
  const int rows = static_cast<int>(m), cols = static_cast<int>(n), rank = std::min(rows, cols);
  std::vector<int> places(8 * static_cast<std::size_t>(rank));
  std::vector<double> work(1);
  int info = 0;
  const auto call = [&](int room) {
    dgesdd_("S", &rows, &cols, x, &rows, s, u, &rows, vt, &rank, work.data(), &room, places.data(),
            &info);
  };
  call(-1);  // only queries the size of the workspace
  work.resize(static_cast<std::size_t>(work[0]));
  call(static_cast<int>(work.size()));
  if (info != 0)
    throw Error(ExitCode::failed, "singular values: the input contains NaN or infinity");
}

}  // namespace echofuse::recon
