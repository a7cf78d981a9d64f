// SPDX-License-Identifier: MIT
#include "sim/sensors/array_kernels.hpp"

#include <cmath>
#include <numbers>

#include "drivers/core/clones.hpp"

namespace echofuse::sim {

ECHOFUSE_CLONES void turn(const float* turns, float* re, float* im, std::size_t count) {
  constexpr float rounding = 12582912;  // 1.5 2^23: what is added to it loses its fraction
  for (std::size_t i = 0; i < count; ++i) {
    const float whole = (turns[i] + rounding) - rounding;
    const float x = (turns[i] - whole) * std::numbers::pi_v<float>, q = x * x;  // half the angle
    const float s = x * (1 + q * (-1.f / 6 + q * (1.f / 120 + q * (-1.f / 5040 + q / 362880))));
    const float c =
        1 + q * (-0.5f + q * (1.f / 24 + q * (-1.f / 720 + q * (1.f / 40320 - q / 3628800))));
    re[i] = 1 - 2 * s * s;
    im[i] = 2 * s * c;
  }
}

ECHOFUSE_CLONES void add_turned(const float* rows, const float* re, const float* im,
                                std::size_t cells, std::size_t padded, float* sum) {
  for (std::size_t m = 0; m < padded; m += lanes) {
    Eight x, y, sum_x, sum_y;
    load(sum_x, sum + m);
    load(sum_y, sum + padded + m);
    const float* row = rows + m;
    for (std::size_t k = 0; k < cells; ++k, row += 2 * padded) {
      load(x, row);
      load(y, row + padded);
      sum_x += re[k] * x - im[k] * y;
      sum_y += re[k] * y + im[k] * x;
    }
    store(sum + m, sum_x);
    store(sum + padded + m, sum_y);
  }
}

void turn_planes(float cosine, float sine, float* re, float* im) {
  for (std::size_t i = 0; i < lanes; ++i) {
    const float x = re[i], y = im[i];
    re[i] = cosine * x - sine * y;
    im[i] = cosine * y + sine * x;
  }
}

void lose_doppler(const float* turns, float factor, std::int64_t chirps, float* re, float* im,
                  std::size_t count) {
  const auto all = static_cast<float>(chirps);
  for (std::size_t i = 0; i < count; ++i) {
    const float half = std::numbers::pi_v<float> * turns[i] * factor, one = std::sin(half);
    const float left = std::abs(one) > 1e-4f ? std::sin(all * half) / (all * one) : 1;
    re[i] *= left;
    im[i] *= left;
  }
}

ECHOFUSE_CLONES void add_scaled(float factor, const float* in, std::size_t count, float* out) {
  for (std::size_t i = 0; i < count; ++i) out[i] += factor * in[i];
}

ECHOFUSE_CLONES void share_row(const float* in, std::size_t row, const float* factors,
                               std::size_t count, float* rows) {
  Eight part, sum;
  for (std::size_t first = 0; first < row; first += lanes) {
    load(part, in + first);
    for (std::size_t j = 0; j < count; ++j) {
      load(sum, rows + j * row + first);
      store(rows + j * row + first, sum + factors[j] * part);
    }
  }
}

ECHOFUSE_CLONES void respond(const float* response, const float* nodes, std::size_t count,
                             std::size_t row, float* out) {
  constexpr std::size_t tile = 8;  // so many sums stay in registers; rows are a multiple of it
  for (std::size_t first = 0; first < row; first += tile) {
    Eight a, b, c, d, e, f, g, h, psf;
    float* to = out + first * lanes;
    load(a, to), load(b, to + lanes), load(c, to + 2 * lanes), load(d, to + 3 * lanes);
    load(e, to + 4 * lanes), load(f, to + 5 * lanes), load(g, to + 6 * lanes);
    load(h, to + 7 * lanes);
    const float* x = nodes + first;
    for (std::size_t j = 0; j < count; ++j, x += row) {
      load(psf, response + j * lanes);
      a += psf * x[0], b += psf * x[1], c += psf * x[2], d += psf * x[3];
      e += psf * x[4], f += psf * x[5], g += psf * x[6], h += psf * x[7];
    }
    store(to, a), store(to + lanes, b), store(to + 2 * lanes, c), store(to + 3 * lanes, d);
    store(to + 4 * lanes, e), store(to + 5 * lanes, f), store(to + 6 * lanes, g);
    store(to + 7 * lanes, h);
  }
}

ECHOFUSE_CLONES void multiply_root(const float* root, const float* q, std::size_t size,
                                   std::size_t padded, float* out) {
  Eight re, im, root_re, root_im;
  for (std::size_t a = 0; a < size; ++a) {
    load(re, out + a * lanes);
    load(im, out + (padded + a) * lanes);
    for (std::size_t b = 0; b <= a; ++b, root += 2 * lanes) {
      load(root_re, root);
      load(root_im, root + lanes);
      re += root_re * q[b] - root_im * q[size + b];
      im += root_re * q[size + b] + root_im * q[b];
    }
    store(out + a * lanes, re);
    store(out + (padded + a) * lanes, im);
  }
}

}  // namespace echofuse::sim
