# SPDX-License-Identifier: MIT
# cmake -DOUT=cloud_page.cpp -DFILES=... -P cloud_page.cmake: modules of the view's page as one script.
set(code "")
foreach(file ${FILES})
  file(READ ${file} text)
  string(REGEX REPLACE "import [^\n]*\n" "" text "${text}")
  string(REGEX REPLACE "(^|\n)export " "\\1" text "${text}")
  string(APPEND code "${text}")
endforeach()
file(WRITE ${OUT} "// Made by recon/output/cloud_page.cmake.
#include \"recon/output/cloud_page.hpp\"
const char* const echofuse::recon::cloud_code = R\"js(${code})js\";
")
