#!/bin/sh
# SPDX-License-Identifier: MIT
# clang.sh HEADERS SOURCES FLAGS...: compiles the file HEADERS and the sources listed in the file SOURCES with clang-14.
# The sources are compiled together with HEADERS, or alone if names conflict.
# Exits with 77 if clang-14 is missing.
command -v clang++-14 > /dev/null || { echo "skipped: clang-14 is not installed (./scripts/setup)"; exit 77; }
headers=$1 sources=$2
shift 2
read=$(mktemp)
trap 'rm "$read"' EXIT
clang++-14 "$@" -x c++-header -fpch-instantiate-templates "$headers" -o "$read" || exit 1
xargs -I {} -P 2 sh -c 'clang++-14 -fsyntax-only -include-pch "$@" 2> /dev/null || { shift; clang++-14 -fsyntax-only "$@"; }' \
  sh "$read" "$@" {} < "$sources"
