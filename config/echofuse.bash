# SPDX-License-Identifier: MIT
# Bash completion of the echofuse programs. The words are read from the --help output of the program.
_echofuse() {
  local current=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} asked=("${COMP_WORDS[0]}")
  local help word options line
  help=$("${asked[@]}" --help 2>/dev/null) options=$help
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do  # collects the subcommands before the cursor
    sed -n '/^Subcommands:/,$p' <<<"$help" | grep -qE "^ {2,4}$word( |$)" || break
    asked+=("$word")
    help=$("${asked[@]}" --help 2>/dev/null) options+=$'\n'$help  # subcommands also accept their parents' options
  done
  # The current word is an option, the value of the preceding option, or a command or argument.
  case $before in
    -*) line=$(grep -E -- "^ {2,4}(-[a-z], ?)?$before [A-Z]" <<<"$options" 2>/dev/null | head -n 1) ;;
    *) line=$(sed -n '/^[Pp]ositional/,/^$/p' <<<"$help") ;;
  esac
  if [[ $current == -* ]]; then
    word=$(grep -oE '^ {2,4}(-[a-z], ?)?--[a-z][a-z-]*' <<<"$options" | grep -o -- '--.*' | sort -u)
  elif [[ $line =~ \{([a-z0-9_.,-]+)\} ]]; then
    word=${BASH_REMATCH[1]//,/ }
  else
    word=$(sed -n '/^Subcommands:/,$p' <<<"$help" | grep -oE '^ {2,4}[a-z]+')
  fi
  mapfile -t COMPREPLY < <({
    compgen -W "$word" -- "$current"  # only words from --help, because the shell would execute code in a file name
    if [[ $current != -* && ! $line =~ \{ ]]; then
      compgen -d -- "$current"
      [[ $line == *' RUN'* ]] && compgen -f -X '!*.sqlite' -- "$current"
      [[ $line == *' MODEL'* ]] && compgen -f -X '!*.safetensors' -- "$current"
      [[ $line =~ ' 'RUN|' 'MODEL|' 'FOLDER ]] || compgen -f -- "$current" | grep -vE -- '-(lock|wal|shm)$'
    fi
  } | sort -u)
}
complete -o filenames -F _echofuse echofuse-acquire echofuse-bench echofuse-export echofuse-recon echofuse-report echofuse-sim echofuse-view
