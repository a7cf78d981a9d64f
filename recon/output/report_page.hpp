// SPDX-License-Identifier: MIT
// Parts of the page of a report, as HTML and drawings.
#pragma once
#include <string>
#include <vector>

#include "recon/output/report.hpp"

namespace echofuse::recon {

std::string short_name(const ModeResult& mode);
std::string title_of(const ModeResult& mode);       // "both sensors: factorised"
std::string stand_alone(const ShownRecord& shown);  // as a file
// What the models leave open: from one sensor a body and its mirror image.
std::string blur_alone(const ShownRecord& shown);   // as a file
std::string first_html(const ShownRecord& shown);   // truth, the subject's map and its error
std::string record_html(const ShownRecord& shown);  // with all that was measured, and all models
std::string gallery_html(const std::vector<ShownRecord>& gallery);
std::string letters_html(const std::vector<ShownLetter>& letters);
std::string errors_html(const Report& report);       // against range and side; distributions
std::string losses_html(const Report& report);       // while training
std::string failures_html(const Report& report);     // what fails, and what the models say of it
std::string labels_html(const ModeResult& subject);  // scores by label
std::string comparison_html(const Report& report);
std::string cloud_html(const ShownRecord& shown);    // the place for the points in space
std::string cloud_script(const ShownRecord& shown);  // what fills it

}  // namespace echofuse::recon
