#!/usr/bin/env bash
# Runs the four processes (or chosen ones) on a data set; `run.sh --help` tells the options.
exec python3 -B "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")/launch.py" "$@"
