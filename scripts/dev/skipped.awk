# SPDX-License-Identifier: MIT
# Filter of ctest's output for scripts/test: prints the skipped tests and their reasons before the closing lines.
# A test names its reason in a line "skipped: REASON"; pytest prints one "SKIPPED [N] PLACE: REASON" for each of its
# own (-rs). Exits with 1 if CI is set and a skipped test names no reason.
/tests passed, / { closing = 1 }
closing { held = held $0 "\n"; next }
/\*\*\*Skipped/ { match($0, /: [^ ]+/); unnamed[substr($0, RSTART + 2, RLENGTH - 2)] = 1 }
{ print; fflush() }
END {
  while ((getline line < log_file) > 0) {
    if (match(line, /^[0-9]+\/[0-9]+ Testing: /)) name = substr(line, RLENGTH + 1)
    if (line ~ /^skipped: / || line ~ /^SKIPPED \[/) {
      sub(/^skipped: /, "", line)
      print "skipped: " name ": " line
      delete unnamed[name]
    }
  }
  for (name in unnamed) {
    print "skipped: " name ": no reason given"
    faults++
  }
  printf "%s", held
  exit ENVIRON["CI"] != "" && faults > 0
}
