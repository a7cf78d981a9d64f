# SPDX-License-Identifier: MIT
# cmake -DOUT=page_shell.cpp -DPAGE=recon/page -P page_shell.cmake: report.html with what it names, as an array.
file(READ ${PAGE}/report.html shell)
set(scripts "")
foreach(name charts.js maps.js cloud.js report.js)
  file(READ ${PAGE}/${name} text)
  # All are one script there.
  string(REGEX REPLACE "import [^\n]*\n" "" text "${text}")
  string(REGEX REPLACE "(^|\n)export " "\\1" text "${text}")
  string(APPEND scripts "${text}")
endforeach()
file(READ ${PAGE}/uPlot.iife.min.js uplot)
file(READ ${PAGE}/uPlot.LICENSE licence)
set(styles "")
foreach(name uPlot.min.css view.css report.css)
  file(READ ${PAGE}/${name} text)
  string(APPEND styles "${text}\n")
endforeach()
string(REPLACE "{{styles}}" "${styles}" shell "${shell}")
string(REPLACE "{{uplot}}" "/*\n${licence}*/\n${uplot}" shell "${shell}")
string(REPLACE "{{scripts}}" "${scripts}" shell "${shell}")
file(WRITE ${OUT}.html "${shell}")
file(READ ${OUT}.html bytes HEX)
string(REGEX REPLACE "(..)" "0x\\1," bytes "${bytes}")
string(REGEX REPLACE "((0x..,){20})" "\\1\n" bytes "${bytes}")
file(WRITE ${OUT} "// Made by recon/page/page_shell.cmake.
#include \"recon/page/page_shell.hpp\"

namespace echofuse::recon {

std::string_view page_shell() {
  static const unsigned char bytes[] = {
${bytes}};
  return {reinterpret_cast<const char*>(bytes), sizeof bytes};
}

}  // namespace echofuse::recon
")
