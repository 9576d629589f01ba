#!/usr/bin/env bash
# Builds every package of the repository with colcon into build/ and install/; the full log is in log/latest_build/.
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: launch_scripts/build.sh [--no-tests] [--sanitize address,undefined|thread] [--jobs N] [--packages NAME...]
  --no-tests      don't build test programs (unless this build folder has them already)
  --sanitize S    a build of its own: build-asan/ and install-asan/, or build-tsan/ and install-tsan/
  --jobs N        compilers at a time (default: one a core, as far as memory allows)
  --packages ...  these packages and what they need, e.g. portolan_frontend_tracker (last option)
TEXT
}

fail() { echo "build.sh: $1" >&2; exit "${2:-1}"; }

testing=ON sanitize="" jobs="" packages=()
while [ $# -gt 0 ]; do
  case "$1" in
    --no-tests) testing=OFF ;;
    --sanitize) sanitize=${2-}; shift ;;
    --jobs) jobs=${2-}; shift ;;
    --packages) shift; packages=("$@"); break ;;
    -h|--help) usage; exit 0 ;;
    *) usage >&2; fail "unknown option '$1'" 2 ;;
  esac
  shift || { usage >&2; fail "the last option needs a value" 2; }
done
case "$sanitize" in
  "") suffix="" ;;
  address,undefined) suffix=-asan ;;
  thread) suffix=-tsan ;;
  *) fail "--sanitize '$sanitize': expected address,undefined or thread" 2 ;;
esac

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
cd "$here/.."
"$here/install_dependencies.sh"

if [ -z "$jobs" ]; then
  # The largest files (Ceres, generated DDS types) take up to 1.5 GB of compiler; sanitizers more.
  megabytes=$(awk '/^MemAvailable/ {print int($2 / 1024)}' /proc/meminfo)
  jobs=$((megabytes / 2000))
  [ "$jobs" -gt "$(nproc)" ] && jobs=$(nproc)
  [ "$jobs" -lt 1 ] && jobs=1
fi
[[ "$jobs" =~ ^[1-9][0-9]*$ ]] || fail "--jobs '$jobs': expected a number from 1" 2
# colcon gives the build tool a number of jobs of its own unless MAKEFLAGS has one; `cmake --build` reads the other variable.
export MAKEFLAGS="-j$jobs" CMAKE_BUILD_PARALLEL_LEVEL="$jobs" NINJA_STATUS="[%f/%t] "

# Turning tests off would only make CMake run again: a build folder that has them keeps them.
if [ "$testing" = OFF ] && grep -qs '^BUILD_TESTING:BOOL=ON' "build$suffix"/*/CMakeCache.txt; then testing=ON; fi

# Lines of the build tool become one progress line on a terminal, and one line in fifty elsewhere.
show_progress() {
  local line package="" steps=0 clear=""
  [ -t 1 ] && clear=$'\r\e[K'
  while IFS= read -r line; do
    case "$line" in
      "Starting >>> "*)
        package=${line#Starting >>> }
        [ -n "$clear" ] || echo "portolan: building $package" ;;
      "Failed   <<< "* | "Aborted  <<< "*) echo "${clear}portolan: $line" ;;
      "["[0-9]*/*"] "*)
        steps=$((steps + 1))
        if [ -n "$clear" ]; then printf '%s%.110s' "$clear" "$package $line"
        elif [ $((steps % 50)) -eq 0 ]; then echo "  $package ${line%%] *}]"; fi ;;
    esac
  done
  printf '%s' "$clear"
}

show_failure() {
  local log found=no
  for log in log/latest_build/*/stdout_stderr.log; do
    grep -sqE '^FAILED: |CMake Error' "$log" || continue
    found=yes
    echo "--- $log"
    awk '/^FAILED: |CMake Error/ {found = 1} found && shown < 80 {print; ++shown}' "$log"
  done
  [ "$found" = yes ] || tail -n 20 log/build_output.log
  echo "build.sh: the build failed; everything it said is in log/latest_build/"
}

select=()
[ ${#packages[@]} -eq 0 ] || select=(--packages-up-to "${packages[@]}")
arguments=(
  --base-paths idl common frontend_tracker backend_mapper loop_closer atlas_server launch_scripts test
  --merge-install --build-base "build$suffix" --install-base "install$suffix" --executor sequential
  "${select[@]}" --event-handlers console_direct+ console_stderr- status- desktop_notification- terminal_title- summary-
  --cmake-args -G Ninja --no-warn-unused-cli "-DBUILD_TESTING=$testing" "-DPORTOLAN_SANITIZE=$sanitize")
started=$SECONDS
mkdir -p log
if ! colcon --log-base log build "${arguments[@]}" 2>&1 | tee log/build_output.log | show_progress; then
  show_failure >&2
  exit 1
fi
echo "portolan: built in $((SECONDS - started)) s, into install$suffix/"
