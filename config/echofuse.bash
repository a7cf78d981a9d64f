# SPDX-License-Identifier: MIT
# Completion of the echofuse programs for bash: asks the program's own --help.
_echofuse() {
  local current=${COMP_WORDS[COMP_CWORD]} asked=("${COMP_WORDS[0]}") help word
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do  # the subcommands before the cursor
    "${asked[@]}" --help 2>/dev/null | sed -n '/^Subcommands:/,$p' | grep -q "^  $word " || break
    asked+=("$word")
  done
  help=$("${asked[@]}" --help 2>/dev/null)
  if [[ $current == -* ]]; then
    word=$(grep -oE '^ +(-[a-z],)?--[a-z][a-z-]*' <<<"$help" | grep -o -- '--.*')
  else
    word=$(sed -n '/^Subcommands:/,$p' <<<"$help" | grep -oE '^  [a-z]+')
  fi
  mapfile -t COMPREPLY < <(compgen -W "$word" -- "$current"; [[ $current == -* ]] || compgen -f -- "$current")
}
complete -o filenames -F _echofuse echofuse-acquire echofuse-recon echofuse-sim echofuse-view
