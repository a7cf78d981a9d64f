// SPDX-License-Identifier: MIT
// Charts, drawn by gnuplot.
#pragma once
#include <string>

namespace echofuse {

// Has gnuplot draw, with `folder` as its own. Throws Error(failed) if it is not there, or does not
// understand the script; `without` says what the user has all the same.
void run_gnuplot(const std::string& script, const std::string& folder, const std::string& without);

// Writes NAME.csv and NAME.gp into a folder that exists, and has gnuplot draw what the script says.
// Throws Error(disk), and Error(failed) as above; the table is written first.
void write_chart(const std::string& folder, const std::string& name, const std::string& csv,
                 const std::string& script);

}  // namespace echofuse
