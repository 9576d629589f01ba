#!/usr/bin/env bash
# The demo that needs no download: renders a drive through a town, tracks it with the four processes in real time, compares with the ground truth.
set -euo pipefail

usage() {
  cat <<'TEXT'
usage: launch_scripts/demo.sh [options of run.sh, such as --dds cyclonedds or --speed max]
Installs what is missing, builds, renders, runs; results are in runs/demo/.
TEXT
}
case "${1-}" in -h|--help) usage; exit 0 ;; esac

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
cd "$here/.."
"$here/build.sh" --no-tests

out=runs/demo data=runs/demo/data
# Half a minute of driving at 20 frames a second: one straight street, a corner, the next street.
scene=(town --frames 600 --fps 20 --size 640x480 --seed 1)
mkdir -p "$out"
# portolan_synth writes its lists last: where they are, the pictures are whole.
if [ -s "$data/rgb.txt" ] && [ -s "$data/groundtruth.txt" ] && [ "$(cat "$out/scene.txt" 2>/dev/null)" = "${scene[*]}" ]; then
  echo "portolan: the town is rendered already ($data)"
else
  echo "portolan: rendering a town, once (about a minute)"
  rm -rf "$data"
  install/bin/portolan_synth "${scene[@]}" --out "$data"
  echo "${scene[*]}" > "$out/scene.txt"
fi

"$here/run.sh" --data "$data" --out "$out" "$@"
echo
install/bin/portolan_eval "$data/groundtruth.txt" "$out/trajectory.txt" --plot "$out/trajectory.svg" --json "$out/evaluation.json"
python3 - "$out" <<'PYTHON'
import json, pathlib, sys
out = pathlib.Path(sys.argv[1])
run = json.loads((out / "summary.json").read_text())
ate = json.loads((out / "evaluation.json").read_text())["joined"].get("ate")
print(f"""
tracked       {run['tracked']} of {run['frames']} frames, {run['maps']} map(s), {run['keyframes']} keyframes, {run['points']} points
ATE           {f"{ate['rmse']:.3f} m (RMSE after alignment)" if ate else "not enough poses to align"}
plot          {out / 'trajectory.svg'}
point cloud   {out / 'map.ply'}""")
PYTHON
