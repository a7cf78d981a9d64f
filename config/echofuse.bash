# SPDX-License-Identifier: MIT
# Completion of the echofuse programs for bash: asks the program's own --help.
_echofuse() {
  local current=${COMP_WORDS[COMP_CWORD]} asked=("${COMP_WORDS[0]}") help word options
  help=$("${asked[@]}" --help 2>/dev/null) options=$help
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do  # the subcommands before the cursor
    sed -n '/^Subcommands:/,$p' <<<"$help" | grep -q "^  $word " || break
    asked+=("$word")
    help=$("${asked[@]}" --help 2>/dev/null) options+=$'\n'$help  # a command takes its parents' options
  done
  if [[ $current == -* ]]; then
    word=$(grep -oE '^ +(-[a-z],)?--[a-z][a-z-]*' <<<"$options" | grep -o -- '--.*' | sort -u)
  else
    word=$(sed -n '/^Subcommands:/,$p' <<<"$help" | grep -oE '^  [a-z]+')
  fi
  mapfile -t COMPREPLY < <(compgen -W "$word" -- "$current"; [[ $current == -* ]] || compgen -f -- "$current")
}
complete -o filenames -F _echofuse echofuse-acquire echofuse-recon echofuse-sim echofuse-view
