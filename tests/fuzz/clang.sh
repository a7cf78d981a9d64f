#!/bin/sh
# SPDX-License-Identifier: MIT
# clang.sh HEADERS SOURCES FLAGS...: compiles the file HEADERS and the sources listed in the file SOURCES with clang.
# The sources are compiled together with HEADERS, or alone if names conflict.
# Exits with 77 if clang is missing.
command -v clang++ > /dev/null || { echo "skipped: clang is not installed (./scripts/setup --tools)"; exit 77; }
headers=$1 sources=$2
shift 2
read=$(mktemp)
trap 'rm "$read"' EXIT
clang++ "$@" -x c++-header -fpch-instantiate-templates "$headers" -o "$read" || exit 1
xargs -I {} -P 2 sh -c 'clang++ -fsyntax-only -include-pch "$@" 2> /dev/null || { shift; clang++ -fsyntax-only "$@"; }' \
  sh "$read" "$@" {} < "$sources"
