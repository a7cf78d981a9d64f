# SPDX-License-Identifier: MIT
# cmake -DOUT=page.cpp -DFILES=... -P embed.cmake: the files of the page as arrays of a C++ source.
set(types_html "text/html; charset=utf-8")
set(types_js "text/javascript; charset=utf-8")
set(types_css "text/css; charset=utf-8")
set(arrays "")
set(rows "")
set(number 0)
foreach(file ${FILES})
  get_filename_component(name ${file} NAME)
  string(REGEX REPLACE ".*\\." "" kind ${name})
  file(READ ${file} bytes HEX)
  string(REGEX REPLACE "(..)" "0x\\1," bytes "${bytes}")
  string(REGEX REPLACE "((0x..,){20})" "\\1\n" bytes "${bytes}")
  string(APPEND arrays "const unsigned char file_${number}[] = {\n${bytes}\n};\n")
  string(APPEND rows "    {\"${name}\", \"${types_${kind}}\", text_of(file_${number})},\n")
  math(EXPR number "${number} + 1")
endforeach()
file(WRITE ${OUT} "// Made by recon/live/embed.cmake.
#include \"recon/live/http.hpp\"

namespace echofuse::view {
namespace {

${arrays}
template <std::size_t n>
std::string_view text_of(const unsigned char (&bytes)[n]) {
  return {reinterpret_cast<const char*>(bytes), n};
}

}  // namespace

const PageFile* page_file(std::string_view name) {
  static const PageFile files[] = {
${rows}  };
  for (const PageFile& file : files)
    if (file.name == name) return &file;
  return nullptr;
}

}  // namespace echofuse::view
")
