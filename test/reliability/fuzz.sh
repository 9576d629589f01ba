#!/usr/bin/env bash
# Fuzzes with libFuzzer what a peer's bytes pass through: decoding, validation, application to a map (common/fuzzing).
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: test/reliability/fuzz.sh [--minutes M] [--jobs N] [--report] [TARGET...]
  --minutes M   for each target (default: 10)
  --jobs N      targets at a time (default: 1)
  --report      runs nothing, prints the last run of each target as a Markdown table
  TARGET        keyframe, replica, correction, message, stored (default: all)
Builds with Clang, the address and the undefined behaviour sanitizer into build-fuzz/. Inputs that reached something new stay in
build-fuzz/corpus/TARGET and are gone on from; an input that fails is left in build-fuzz/findings/, and
  build-fuzz/common/fuzzing/portolan_fuzz_TARGET FILE
repeats it. The exit code is 1 if there is one.
TEXT
}

fail() { echo "fuzz.sh: $1" >&2; exit "${2:-1}"; }

minutes=10 jobs=1 report=no targets=()
while [ $# -gt 0 ]; do
  case "$1" in
    --minutes) minutes=${2-}; shift ;;
    --jobs) jobs=${2-}; shift ;;
    --report) report=yes ;;
    -h|--help) usage; exit 0 ;;
    keyframe|replica|correction|message|stored) targets+=("$1") ;;
    *) usage >&2; fail "unknown option or target '$1'" 2 ;;
  esac
  shift || { usage >&2; fail "the last option needs a value" 2; }
done
[[ "$minutes" =~ ^[1-9][0-9]*$ ]] || fail "--minutes '$minutes': expected a number from 1" 2
[[ "$jobs" =~ ^[1-9][0-9]*$ ]] || fail "--jobs '$jobs': expected a number from 1" 2
[ ${#targets[@]} -gt 0 ] || targets=(keyframe replica correction message stored)

cd "$(dirname "${BASH_SOURCE[0]}")/../.."
root=$PWD/build-fuzz

# 1982588 as 1 982 588.
group() { sed -E ':a; s/([0-9])([0-9]{3})( |$)/\1 \2\3/; ta' <<<"$1"; }

if [ $report = yes ]; then
  rows=""
  for target in "${targets[@]}"; do
    [ -f "$root/$target.result" ] || continue
    IFS=$'\t' read -r seconds runs coverage found <"$root/$target.result"
    rows+="| $target | $(awk -v s="$seconds" 'BEGIN { printf s < 60 ? "%.1f" : "%.0f", s / 60 }') | $(group "$runs") | $coverage | $found |"$'\n'
  done
  [ -n "$rows" ] || fail "no target was run yet: build-fuzz/ has no results"
  printf '| target | minutes | inputs | edges | found |\n| --- | --- | --- | --- | --- |\n%s' "$rows"
  exit 0
fi

launch_scripts/install_dependencies.sh --with fuzz
mkdir -p "$root/findings"
touch "$root/COLCON_IGNORE"

common=(-G Ninja -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ -DBUILD_TESTING=OFF -DPORTOLAN_SANITIZE=address,undefined
        "-DCMAKE_CXX_FLAGS=-fsanitize=fuzzer-no-link -Wno-unknown-warning-option"
        "-DCMAKE_INSTALL_PREFIX=$root/install" "-DCMAKE_PREFIX_PATH=$root/install")
echo "fuzz.sh: building into build-fuzz/"
{
  cmake -S idl -B "$root/idl" "${common[@]}"
  cmake --build "$root/idl" --target install
  cmake -S common -B "$root/common" "${common[@]}" -DPORTOLAN_FUZZ=ON
  cmake --build "$root/common" --target "${targets[@]/#/portolan_fuzz_}"
} >"$root/build.log" 2>&1 || { grep -E -m 20 'error|FAILED' "$root/build.log" >&2; fail "the build failed: build-fuzz/build.log"; }

# One target: its line of figures, the same for --report in TARGET.result (seconds, inputs, edges, what was found), and code 1 if an input failed.
fuzz() {
  local target=$1 log=$root/$1.log program=$root/common/fuzzing/portolan_fuzz_$1 code=0
  mkdir -p "$root/corpus/$target"
  rm -f "$root/$target.result"
  SECONDS=0
  PORTOLAN_FUZZ_SEEDS="$root/corpus/$target" UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1 \
    "$program" "$root/corpus/$target" -max_total_time=$((60 * minutes)) -max_len=60000 -timeout=20 -rss_limit_mb=1500 \
    -print_final_stats=1 "-artifact_prefix=$root/findings/$target-" >"$log" 2>&1 || code=1
  local seconds=$SECONDS runs coverage found=nothing
  runs=$(grep -a 'stat::number_of_executed_units' "$log" | awk '{print $2}' || true)
  coverage=$(grep -aoE 'cov: [0-9]+' "$log" | tail -n 1 | cut -d' ' -f2 || true)
  [ $code = 0 ] || found=$(grep -am 1 '^SUMMARY: ' "$log" | cut -d' ' -f2- | tr '|\t' '/ ' || true)
  printf '%s\t%s\t%s\t%s\n' "$seconds" "${runs:-?}" "${coverage:-?}" "${found:-a failure, see the log}" >"$root/$target.result"
  echo "fuzz.sh: $target: ${runs:-?} inputs, ${coverage:-?} edges, $([ $code = 0 ] && echo 'nothing found' || echo "FAILED: build-fuzz/$target.log")"
  return $code
}
export -f fuzz
export root minutes

echo "fuzz.sh: ${#targets[@]} targets, $minutes min each, $jobs at a time"
if ! printf '%s\n' "${targets[@]}" | xargs -P "$jobs" -I{} bash -c 'fuzz {}'; then exit 1; fi
