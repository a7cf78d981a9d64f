# SPDX-License-Identifier: MIT
# Filters ctest's output for scripts/test: prints the skipped tests and their reasons before the closing lines.
# A test prints its reason in a line "skipped: REASON"; pytest prints "SKIPPED [N] PLACE: REASON" for each test (-rs).
# A test that passes without a check that a starved machine cannot make prints "not checked: CHECK: MEASURED WAIT".
# Exits with 1 if CI is set and a skipped test has no reason.
/tests passed, / { closing = 1 }
closing { held = held $0 "\n"; next }
/\*\*\*Skipped/ { tests++; match($0, /: [^ ]+/); unnamed[substr($0, RSTART + 2, RLENGTH - 2)] = 1 }
{ print; fflush() }
END {
  while ((getline line < log_file) > 0) {
    if (match(line, /^[0-9]+\/[0-9]+ Testing: /)) name = substr(line, RLENGTH + 1)
    if (line ~ /^not checked: /) {
      sub(/^not checked: /, "", line)
      print "not checked: " name ": " line
      unchecked++
    }
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
  printf "%d tests skipped, %d checks not made because a process was starved\n%s", tests, unchecked, held
  exit ENVIRON["CI"] != "" && faults > 0
}
