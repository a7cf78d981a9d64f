// SPDX-License-Identifier: MIT
// Inner loops of radar_array.cpp. A row is what one point, cell or node has at all antennas: all
// real parts, then all imaginary ones, both filled up to `padded`, a multiple of eight
// (clones.hpp).
#pragma once
#include <cstddef>
#include <cstdint>

namespace echofuse::sim {

// exp(2 pi i t) of each; exact to 1e-5.
void turn(const float* turns, float* re, float* im, std::size_t count);

// Adds (re + i im) times the row of each cell.
void add_turned(const float* rows, const float* re, const float* im, std::size_t cells,
                std::size_t padded, float* sum);

// Planes of `lanes` numbers, real and imaginary, times a complex number.
void turn_planes(float cosine, float sine, float* re, float* im);

// re and im times sin(pi f chirps) / (chirps sin(pi f)), f = turns[i] * factor.
void lose_doppler(const float* turns, float factor, std::int64_t chirps, float* re, float* im,
                  std::size_t count);

// out[i] += factor * in[i]
void add_scaled(float factor, const float* in, std::size_t count, float* out);

// Adds the row, times factors[j], to row j of `rows`.
void share_row(const float* in, std::size_t row, const float* factors, std::size_t count,
               float* rows);

// Adds to each of `lanes` points the nodes' rows, of size `row`, times their responses there. By
// planes: out has `lanes` numbers for each number of a row, `response` as many for each node.
void respond(const float* response, const float* nodes, std::size_t count, std::size_t row,
             float* out);

// The same with a lower triangular matrix of `size` rows in place of the responses, and q, `size`
// real and `size` imaginary parts, in place of nodes: x = L q. The matrix has, row by row up to the
// diagonal, `lanes` real and `lanes` imaginary parts.
void multiply_root(const float* root, const float* q, std::size_t size, std::size_t padded,
                   float* out);

}  // namespace echofuse::sim
