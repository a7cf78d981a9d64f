// SPDX-License-Identifier: MIT
// Private data of the public classes, which are declared in recon/include/echofuse.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/run_file.hpp"
#include "echofuse/model.hpp"
#include "echofuse/run.hpp"
#include "recon/predict/trained_model.hpp"

namespace echofuse {

struct Run::File {
  std::string path;
  std::shared_ptr<const record::RunReader> reader;
};

struct Record::Contents {
  record::FusedRecord record;
  std::vector<float> depth_m;
};

struct Model::File {
  recon::TrainedModel model;
  std::string inputs;
};

// Gives recon/api access to the private members of the public classes.
struct Internals {
  using RunFile = Run::File;
  using RecordContents = Record::Contents;
  static Run run(std::shared_ptr<const Run::File> file) { return Run(std::move(file)); }
  static Record record(std::shared_ptr<const Record::Contents> contents) {
    return Record(std::move(contents));
  }
  static const record::RunReader& reader(const Run& run) { return *run.file_->reader; }
  static const recon::TrainedModel& model(const Model& model) { return model.file_->model; }
};

RunAxis public_axis(const Axis& axis);
MapGrid public_grid(const record::MapGrid& grid);

}  // namespace echofuse
