#!/usr/bin/env bash
# Builds everything with its tests, runs all of them, and ends with the line "N passed, N failed, N skipped".
# Exit code 0 only when something passed and nothing failed.
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: launch_scripts/test.sh [--sanitize address,undefined|thread] [--jobs N] [--filter REGEX]
  --sanitize S    build and test under a sanitizer, in a build folder of its own
  --jobs N        compilers at a time (see build.sh)
  --filter REGEX  only CTest entries whose name matches
TEXT
}

build_arguments=() suffix="" filter=""
while [ $# -gt 0 ]; do
  case "$1" in
    --sanitize)
      [ "${2-}" = thread ] && suffix=-tsan || suffix=-asan  # build.sh refuses anything else
      build_arguments+=("$1" "${2-}"); shift ;;
    --jobs) build_arguments+=("$1" "${2-}"); shift ;;
    --filter) filter=${2-}; shift ;;
    -h|--help) usage; exit 0 ;;
    *) usage >&2; echo "test.sh: unknown option '$1'" >&2; exit 2 ;;
  esac
  shift || { usage >&2; echo "test.sh: the last option needs a value" >&2; exit 2; }
done

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
"$here/build.sh" "${build_arguments[@]}"
cd "$here/.."

# Results of earlier runs must not be counted again.
rm -rf "build$suffix"/*/Testing "build$suffix"/*/test_results

export ASAN_OPTIONS=${ASAN_OPTIONS-detect_stack_use_after_return=1}
export UBSAN_OPTIONS=${UBSAN_OPTIONS-print_stacktrace=1:halt_on_error=1}
# Debian's libraries are not built for ThreadSanitizer: what they do inside is not ours to judge.
export TSAN_OPTIONS=${TSAN_OPTIONS-ignore_noninstrumented_modules=1:second_deadlock_stack=1}

# Tests that start several processes have CTest's RUN_SERIAL; the others share two cores.
ctest_arguments=(-j 2)
[ -z "$filter" ] || ctest_arguments+=(-R "$filter")
started=$SECONDS
colcon_failed=()
colcon --log-base log test --base-paths idl common frontend_tracker backend_mapper loop_closer atlas_server launch_scripts test \
  --merge-install --build-base "build$suffix" --install-base "install$suffix" --executor sequential \
  --event-handlers console_start_end+ console_stderr- status- desktop_notification- terminal_title- summary- \
  --ctest-args "${ctest_arguments[@]}" || colcon_failed=(--failed "colcon test ended with code $?")
echo "portolan: tests took $((SECONDS - started)) s"
exec python3 "$here/count_tests.py" "build$suffix" "${colcon_failed[@]}"
