"""Runs portolan_pipeline_run, for the benchmarks that go over many of its runs."""

import subprocess


def run(program, sequence, out, settings, *options):
    """What it prints; its trajectories are in `out`. `settings`: KEY=VALUE of the configuration. RuntimeError with its words if it fails."""
    command = [program, "--data", sequence, "--out", out, "--log", "error", *options]
    for setting in settings:
        command += ["--set", setting]
    done = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"portolan_pipeline_run on {sequence} ended with {done.returncode}: {done.stderr.strip()}")
    return done.stdout
