# SPDX-License-Identifier: MIT
# Writes a function that returns the commit of the sources: cmake -DSOURCE=ROOT -DOUT=commit.cpp -P commit.cmake
# In an archive made by git, commit.txt contains the commit. "+" after the commit means that the sources were modified.
cmake_policy(VERSION 3.20)
file(READ ${SOURCE}/drivers/util/commit.txt commit)
string(STRIP "${commit}" commit)
if(commit MATCHES "Format")
  set(ENV{GIT_OPTIONAL_LOCKS} 0)
  execute_process(COMMAND git describe --always --dirty=+ --abbrev=9 --exclude=* WORKING_DIRECTORY ${SOURCE}
                  OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
  if(failed)
    set(commit "commit unknown")
  endif()
endif()
file(CONFIGURE OUTPUT ${OUT} CONTENT "#include \"drivers/util/console.hpp\"

const char* echofuse::commit() { return \"@commit@\"; }
" @ONLY)
