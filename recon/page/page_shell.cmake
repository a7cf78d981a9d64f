# SPDX-License-Identifier: MIT
# cmake -DOUT=page_shell.cpp -DPAGE=recon/page -P page_shell.cmake: report.html with what it names, as an array.
file(READ ${PAGE}/report.html shell)

# put(PLACE TEXT HASH): TEXT at {{PLACE}} of the shell, and its hash for the page's policy: the browser obeys no other.
function(put place text hash)
  string(SHA256 hex "${text}")
  set(digits ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/)
  set(base64 "")
  foreach(at RANGE 0 60 6)
    string(SUBSTRING "${hex}00" ${at} 6 three)
    foreach(shift 18 12 6 0)
      math(EXPR digit "0x${three} >> ${shift} & 63")
      string(SUBSTRING ${digits} ${digit} 1 digit)
      string(APPEND base64 ${digit})
    endforeach()
  endforeach()
  string(REGEX REPLACE "A$" "=" base64 ${base64})  # 32 bytes are 43 digits
  string(REPLACE "{{${place}}}" "${text}" shell "${shell}")
  set(shell "${shell}" PARENT_SCOPE)
  set(${hash} "'sha256-${base64}'" PARENT_SCOPE)
endfunction()

set(scripts "\n")
foreach(name charts.js maps.js cloud.js report.js)
  file(READ ${PAGE}/${name} text)
  # All are one script there.
  string(REGEX REPLACE "import [^\n]*\n" "" text "${text}")
  string(REGEX REPLACE "(^|\n)export " "\\1" text "${text}")
  string(APPEND scripts "${text}")
endforeach()
file(READ ${PAGE}/uPlot.iife.min.js uplot)
file(READ ${PAGE}/uPlot.LICENSE licence)
set(styles "\n")
foreach(name uPlot.min.css view.css report.css)
  file(READ ${PAGE}/${name} text)
  string(APPEND styles "${text}\n")
endforeach()
put(styles "${styles}" style_hash)
put(uplot "\n/*\n${licence}*/\n${uplot}\n" uplot_hash)
put(scripts "${scripts}" scripts_hash)
string(REPLACE "{{style_hash}}" "${style_hash}" shell "${shell}")
string(REPLACE "{{script_hashes}}" "${uplot_hash} ${scripts_hash}" shell "${shell}")
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
