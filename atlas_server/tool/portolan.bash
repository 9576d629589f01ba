# Completion of the command `portolan` for bash; installed into share/bash-completion/completions/portolan.
# Names of maps are asked for from the atlas_server that the command line names, within a second.

_portolan_maps() {
  local options=() i
  for ((i = 1; i < COMP_CWORD; ++i)); do
    case ${COMP_WORDS[i]} in
      --domain|--dds|--security|--partition|--robot|--config|--set) options+=("${COMP_WORDS[i]}" "${COMP_WORDS[i + 1]}") ;;
    esac
  done
  portolan maps --names --timeout 1 "${options[@]}" 2>/dev/null
  echo last
}

_portolan() {
  local current=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} command='' i
  local common='--config --set --domain --dds --security --partition --robot --timeout --log-level --help'
  local commands='status metrics maps graph save load export activate fuse delete new-map global-ba pause resume localize-only swap'
  for ((i = 1; i < COMP_CWORD; ++i)); do
    case " $commands " in *" ${COMP_WORDS[i]} "*) command=${COMP_WORDS[i]}; break ;; esac
  done
  COMPREPLY=()
  case $before in
    --dds) mapfile -t COMPREPLY < <(compgen -W 'fastdds cyclonedds' -- "$current"); return ;;
    --config|--security|--file|--dot|--svg|--ply|--tum|--map) mapfile -t COMPREPLY < <(compgen -f -- "$current"); return ;;
    --set|--domain|--partition|--robot|--timeout|--listen) return ;;
    --log-level) mapfile -t COMPREPLY < <(compgen -W 'trace debug info warn error off' -- "$current"); return ;;
  esac
  local words=$common
  case $command in
    '') words="$commands $common --version" ;;
    status) words="--json --watch $common" ;;
    metrics) words="--listen --file $common" ;;
    maps) words="--json --names $common" ;;
    graph) words="--json --dot --svg $common" ;;
    load) [[ $current == -* ]] && words="--there $common" || { mapfile -t COMPREPLY < <(compgen -f -- "$current"); return; } ;;
    export) words="--ply --tum --map $common" ;;
    localize-only) words="on off $common" ;;
    swap) words="mapper loop_closer atlas_server --json $common" ;;
  esac
  case $command in
    export|activate|fuse|delete|global-ba) [[ $current == -* ]] || words="$(_portolan_maps)" ;;
  esac
  mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
}

complete -F _portolan portolan
