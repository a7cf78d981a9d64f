// SPDX-License-Identifier: MIT
// Private data of the public classes, which are declared in recon/include/echofuse.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/run_reader.hpp"
#include "drivers/util/caused_error.hpp"
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
  std::vector<float> map;
  std::shared_ptr<const record::RunHead> run;
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
  static const Record::Contents& contents(const Record& record) { return *record.contents_; }
  static const recon::TrainedModel& model(const Model& model) { return model.file_->model; }
};

// Calls `body` and converts an Error to an Exception. `failed`: code of an Error(failed) that
// states no cause.
template <class Body>
auto guarded(ErrorCode failed, const Body& body) try {
  return body();
} catch (const CausedError& error) {
  constexpr ErrorCode codes[] = {ErrorCode::not_found, ErrorCode::other_format, ErrorCode::in_use,
                                 ErrorCode::disk};
  throw Exception(codes[static_cast<std::size_t>(error.cause())], error.what());
} catch (const Error& error) {
  throw Exception(error.code() == ExitCode::failed ? failed
                  : error.code() == ExitCode::disk ? ErrorCode::disk
                                                   : ErrorCode::usage,
                  error.what());
}

RunAxis public_axis(const Axis& axis);
MapGrid public_grid(const record::MapGrid& grid);

}  // namespace echofuse
