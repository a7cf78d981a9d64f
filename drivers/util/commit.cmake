# SPDX-License-Identifier: MIT
# cmake -DSOURCE=ROOT -DOUT=commit.cpp -P commit.cmake: the commit of the sources as a function. Of an archive that
# git made it is in commit.txt; "+" behind it: the sources were changed since.
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
