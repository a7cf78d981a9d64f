// SPDX-License-Identifier: MIT
// A trained model as an ONNX file (opset 11), for other people's runtimes.
//
//   input   "record"   f32 [n, inputs]: of a plain network SPD histogram ++ radar profile of a
//                      record, each brought to strength by the model's scaling (features.hpp), as
//                      Features::normalised_inputs has it; of one that places a body the aligned
//                      inputs (Alignment::with_correlations)
//   output  "depth_m"  f32 [n, N, N]: metres, as the model makes it, not clipped to 0..6 m
//   metadata           inputs, scaling (or "aligned"), and of each axis in use "NAME_axis":
//                      quantity, unit, count, start and step
// Centre and gain of the training set are the graph's first nodes. Aligning a record is no part of
// it: that needs a median, and OpenCV 4.6 has no operator that sorts.
#pragma once
#include <string>

#include "drivers/core/bytes.hpp"
#include "recon/estimator/trained_model.hpp"

namespace echofuse::recon {

// Throws Error(failed) if the model is no network (Model::layers, body_layers); `path` is its file.
Bytes to_onnx(const TrainedModel& model, const std::string& path);

}  // namespace echofuse::recon
