// SPDX-License-Identifier: MIT
// A trained network as an ONNX file (opset 11: Sub, Mul, Gemm, Relu, Reshape), for other
// people's runtimes.
//
//   input   "record"   f32 [n, inputs]: SPD histogram ++ radar profile of a record, each brought to
//                      strength by the model's scaling (features.hpp), as
//                      Features::normalised_inputs has it
//   output  "depth_m"  f32 [n, N, N], N the map's pixels: metres, as the model makes it, not
//   clipped to 0..6 m metadata           inputs, scaling, and of each axis in use "NAME_axis":
//   quantity, unit, count,
//                      start and step
// Centre and gain of the training set are the graph's first nodes.
// Source: onnx.proto of ONNX 1.12 (field numbers), protobuf.dev/programming-guides/encoding.
#pragma once
#include <string>

#include "drivers/core/bytes.hpp"
#include "recon/estimator/trained_model.hpp"

namespace echofuse::recon {

// Throws Error(failed) if the model is no chain of layers (Model::layers); `path` is
// its file.
Bytes to_onnx(const TrainedModel& model, const std::string& path);

}  // namespace echofuse::recon
