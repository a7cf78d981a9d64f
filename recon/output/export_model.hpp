// SPDX-License-Identifier: MIT
// A model, or the records as it sees them, for other people's tools.
#pragma once
#include <string>
#include <vector>

namespace echofuse::recon {

// By the ending of `to`: x.onnx is the network (onnx.hpp); x.npz the records of `runs` that have
// the model's sensors and depth, as NumPy arrays:
//   record   f32 [n, inputs]  the input of the ONNX network
//   depth_m  f32 [n, N, N]    the truth, 0 = no return
//   index    i64 [n]          the record's number in its run
//   part     u8 [n]           in the model's training: 0 train, 1 validation, 2 test, 255 not seen
// Throws Error(usage) for another ending, or if `runs` and .npz do not come together.
void export_model(const std::string& model, const std::vector<std::string>& runs,
                  const std::string& to);

}  // namespace echofuse::recon
