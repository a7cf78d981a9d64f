// SPDX-License-Identifier: MIT
// The scores of a cross-validation in a study file: what several processes measure, or one that was
// interrupted. A measurement is a map: axis "fold", value the fold, seed the map's number in it.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "recon/estimator/crossvalidate.hpp"
#include "recon/study/study_file.hpp"

namespace echofuse::recon {

// The settings that scores depend on, of data and fit; `more`: those of the command. Inputs, models
// and folds are in the key.
StudySettings fold_settings(const Dataset& data, const std::string& scaling, const FitOptions& fit,
                            const StudySettings& more);

class FoldFile {
 public:
  // Throws as StudyFile.
  FoldFile(const StudyOptions& options, const StudySettings& settings, const std::string& inputs,
           const std::vector<std::string>& models, std::size_t folds);
  FoldFile(const FoldFile&) = delete;  // shared() refers to it
  FoldFile& operator=(const FoldFile&) = delete;

  const SharedFolds& shared() const { return shared_; }
  void finish() { file_.finish(); }  // of a part: puts its file into the folder

 private:
  using Key = std::pair<std::size_t, std::size_t>;  // fold, model
  Measurement row_of(const Key& key, std::size_t map) const;
  void read();
  void keep(const Key& key, const FoldScores& scores);

  StudyFile file_;
  bool part_;
  std::string inputs_;
  std::vector<std::string> models_;
  std::vector<bool> mine_;  // by fold, model
  std::map<Key, FoldScores> known_;
  SharedFolds shared_;
};

}  // namespace echofuse::recon
