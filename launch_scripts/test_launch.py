#!/usr/bin/env python3
"""Tests of run.sh with stubs in place of the four programs (launch_stub.py)."""

import errno
import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from unittest import mock

import launch_arguments
import launch_processes
import launch_summary

HERE = pathlib.Path(__file__).resolve().parent
BACK_ENDS = ("atlas_server", "backend_mapper", "loop_closer")
# Generous: reached only if the launcher hangs.
TIMEOUT_S = 60


def report(role, **more):
    return {"role": role, "dds": "fastdds", "priority": "nice 0", "build": "0.1.0 RelWithDebInfo", "peak_memory_mb": 100.0, "cpu_s": 2.5,
            "stages_ms": {"work": {"median": 1.0, "p95": 2.0, "count": 3}}, "bytes_sent": {"process_status": 10}, "counters": {}, **more}


FRONTEND_REPORT = report("frontend_tracker", bytes_sent={"keyframe": 7, "process_status": 5}, frames=10, tracked=9, lost=0, dropped=1, maps=1,
                         keyframes=4, points=200, links=0, unlinked_maps=0, switches=0, fusions=0, refused_moves=0, frames_to_new_map=[9],
                         frame_ms={"median": 20.0, "p95": 30.0}, lens_residual=[0, 0], bytes_per_keyframe=7, keyframes_sent=1, keyframes_sent_again=0,
                         keyframes_unacknowledged=0, keyframes_given_up=0)

LOOP_REPORT = report("loop_closer", loops=1, closures=[{"stamp_ns": 9, "matched_stamp_ns": 2}], refusals=[], loop_counters={"closed": 1})


class RunTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.out = self.folder / "out"
        self.data = self.folder / "data"
        self.data.mkdir()
        self.bin = self.folder / "bin"
        self.bin.mkdir()
        for role in launch_arguments.ROLES:
            program = self.bin / role.program
            program.write_text(f"#!{sys.executable}\n" + (HERE / "launch_stub.py").read_text())
            program.chmod(0o755)
        self.up = self.folder / "up"
        os.mkfifo(self.up)
        # The frontend ends once all back ends are up; these wait to be ended.
        self.behaviour = {role: {"announce": True, "wait": "signal", "report": report(role)} for role in BACK_ENDS}
        self.behaviour["loop_closer"]["report"] = LOOP_REPORT
        self.behaviour["frontend_tracker"] = {"wait": "up", "others": len(BACK_ENDS), "report": FRONTEND_REPORT}

    def environment(self):
        return {**os.environ, "PORTOLAN_STUB": json.dumps(self.behaviour), "PORTOLAN_STUB_UP": str(self.up)}

    def start(self, *arguments, data=True):
        command = [str(HERE / "run.sh"), "--bin", str(self.bin), "--out", str(self.out), *arguments]
        if data:
            command += ["--data", str(self.data)]
        process = subprocess.Popen(command, env=self.environment(), stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.addCleanup(process.communicate)
        self.addCleanup(process.kill)  # first: cleanups run in reverse order
        return process

    def run_to_end(self, *arguments, data=True):
        process = self.start(*arguments, data=data)
        _, errors = process.communicate(timeout=TIMEOUT_S)
        return process.returncode, errors

    def summary(self):
        return json.loads((self.out / "summary.json").read_text())

    def arguments_of(self, role):
        return json.loads((self.out / f"{role}.arguments").read_text())

    def wait_until_up(self, count):
        fifo = os.open(self.up, os.O_RDWR)
        self.addCleanup(os.close, fifo)
        for _ in range(count):
            os.read(fifo, 1)

    def read_until(self, process, text):
        for line in process.stderr:
            if text in line:
                return
        self.fail(f"'{text}' was never said")


class WholeRunTest(RunTest):
    def test_merges_the_figures_of_all_processes(self):
        code, errors = self.run_to_end()
        self.assertEqual(code, 0, errors)
        summary = self.summary()
        for key in launch_summary.FRONTEND_KEYS:
            self.assertEqual(summary[key], FRONTEND_REPORT[key])
        for key in ("loops", "closures", "refusals", "loop_counters"):
            self.assertEqual(summary[key], LOOP_REPORT[key])
        self.assertEqual(summary["bytes_sent"], {"keyframe": 7, "process_status": 35})
        roles = {*BACK_ENDS, "frontend_tracker"}
        for key in ("stages_ms", "peak_memory_mb", "cpu_s", "dds", "priority", "build"):
            self.assertEqual(set(summary[key]), roles)
        self.assertEqual(summary["exit_codes"], {role: 0 for role in roles})
        self.assertEqual(summary["data"], str(self.data))

    def test_passes_each_process_its_options(self):
        config = self.folder / "my config.yaml"
        config.write_text("")
        code, errors = self.run_to_end("--config", str(config), "--set", "a.b=1", "--set", "c=[1, 2]", "--robot", "3", "--domain", "17",
                                       "--peers", "10.0.0.1, 10.0.0.2", "--dds", "fastdds", "--dds-mapper", "cyclonedds", "--speed", "0.5")
        self.assertEqual(code, 0, errors)
        common = ["--out", str(self.out), "--config", str(config), "--set", "a.b=1", "--set", "c=[1, 2]",
                  "--set", "dds.peers=[10.0.0.1, 10.0.0.2]", "--robot", "3", "--domain", "17", "--dds"]
        self.assertEqual(self.arguments_of("backend_mapper"), [*common, "cyclonedds"])
        self.assertEqual(self.arguments_of("loop_closer"), [*common, "fastdds"])
        self.assertEqual(self.arguments_of("frontend_tracker"), [*common, "fastdds", "--data", str(self.data), "--speed", "0.5"])

    def test_derives_one_domain_for_all(self):
        self.run_to_end()
        domains = {self.arguments_of(role)[self.arguments_of(role).index("--domain") + 1] for role in self.behaviour}
        self.assertEqual(len(domains), 1)
        self.assertIn(int(domains.pop()), range(1, 102))
        self.assertNotIn("--dds", self.arguments_of("backend_mapper"))  # left to the configuration

    def test_figures_of_an_earlier_run_are_not_taken(self):
        self.run_to_end()
        del self.behaviour["loop_closer"]["report"]
        code, errors = self.run_to_end()
        self.assertEqual(code, 0, errors)
        self.assertIn("loop_closer left no figures", errors)
        self.assertNotIn("loop_closer", self.summary()["cpu_s"])

    def test_broken_report_is_named(self):
        self.behaviour["loop_closer"]["report"] = [1]
        _, errors = self.run_to_end()
        self.assertIn("loop_closer.json: expected a JSON object", errors)


class FailureTest(RunTest):
    def test_exit_code_of_the_frontend_is_the_runs(self):
        self.behaviour["frontend_tracker"].update(code=2, say="camera.yaml:3: fx: expected a number above 0")
        code, errors = self.run_to_end()
        self.assertEqual(code, 2)
        self.assertIn("camera.yaml:3: fx", errors)
        self.assertEqual(self.summary()["exit_codes"]["frontend_tracker"], 2)

    def test_back_end_that_dies_is_reported_and_the_run_goes_on(self):
        go_on = self.folder / "go_on"
        os.mkfifo(go_on)
        self.behaviour["backend_mapper"] = {"code": 4, "say": "map 0.1.1 has an owner"}
        self.behaviour["frontend_tracker"].update(wait="file", path=str(go_on))
        self.behaviour["atlas_server"] = self.behaviour["loop_closer"] = {"code": 0}
        process = self.start()
        self.read_until(process, "backend_mapper failed (code 4)")
        self.read_until(process, "map 0.1.1 has an owner")
        go_on.write_text("")
        process.communicate(timeout=TIMEOUT_S)
        self.assertEqual(process.returncode, 4)
        self.assertEqual(self.summary()["frames"], 10)  # the frontend came to its end

    def test_back_end_that_fails_at_its_end_counts(self):
        self.behaviour["atlas_server"]["code"] = 1
        self.assertEqual(self.run_to_end()[0], 1)

    def test_back_end_that_refuses_what_it_was_given_ends_the_run(self):
        for role in self.behaviour:
            self.behaviour[role] = {"wait": "signal"}  # for ever, if it did not end
        self.behaviour["loop_closer"] = {"code": 2, "say": "loop.no_such_key: unknown"}
        code, errors = self.run_to_end()
        self.assertEqual(code, 2)
        self.assertIn("loop.no_such_key", errors)
        self.assertIn("ending the run", errors)

    def test_program_that_cannot_start_is_a_failure(self):
        (self.bin / "portolan_loop_closer").write_text("#!/no/such/interpreter\n")
        self.behaviour["frontend_tracker"]["others"] = 2
        code, errors = self.run_to_end()
        self.assertNotEqual(code, 0)
        self.assertIn("loop_closer failed", errors)

    def test_start_that_fails_ends_those_started(self):
        (self.out / "logs").mkdir(parents=True)
        with mock.patch.object(launch_processes, "END_WITH_LAUNCHER", ("/no/such/program",)), mock.patch.object(launch_processes, "say") as say:
            supervisor = launch_processes.Supervisor({"atlas_server": [], "frontend_tracker": []}, self.out)
            self.assertEqual(supervisor.run(), launch_processes.EXIT_FAILURE)
        say.assert_called_once()
        self.assertIn("atlas_server can't be started", say.call_args.args[0])

    def test_killed_launcher_leaves_no_process_behind(self):
        self.behaviour["frontend_tracker"].update(announce=True, wait="signal")
        process = self.start()
        self.wait_until_up(4)
        process.kill()
        process.communicate(timeout=TIMEOUT_S)  # returns when nobody holds its standard output any more: the frontend ended


class SignalTest(RunTest):
    def test_interrupt_goes_to_the_frontend_then_to_the_others(self):
        self.behaviour["frontend_tracker"].update(announce=True, wait="signal", code=130)
        process = self.start()
        self.wait_until_up(4)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=TIMEOUT_S)
        self.assertEqual(process.returncode, 130)
        self.assertEqual(self.summary()["exit_codes"], {**{role: 0 for role in BACK_ENDS}, "frontend_tracker": 130})

    def test_back_ends_alone_end_with_0_on_terminate(self):
        process = self.start("--roles", "atlas,mapper", data=False)
        self.wait_until_up(2)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=TIMEOUT_S)
        self.assertEqual(process.returncode, 0)
        self.assertEqual(set(self.summary()["exit_codes"]), {"atlas_server", "backend_mapper"})
        self.assertNotIn("--domain", self.arguments_of("atlas_server"))  # all machines must agree: the configuration's

    def test_standbys_are_told_that_they_are(self):
        for role in BACK_ENDS:
            self.behaviour[role] = {"report": report(role)}  # ends by itself
        code, errors = self.run_to_end("--roles", "mapper,loop", "--standby", "--domain", "17", data=False)
        self.assertEqual(code, 0, errors)
        for role in ("backend_mapper", "loop_closer"):
            self.assertEqual(self.arguments_of(role), ["--out", str(self.out), "--domain", "17", "--standby"])

    def test_second_interrupt_kills(self):
        for behaviour in self.behaviour.values():
            behaviour.update(announce=True, wait="signal", ignore=["SIGINT", "SIGTERM"])
        process = self.start()
        self.wait_until_up(4)
        process.send_signal(signal.SIGINT)
        self.read_until(process, "once more kills it")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=TIMEOUT_S)
        self.assertEqual(process.returncode, 128 + signal.SIGKILL)
        self.assertEqual(set(self.summary()["exit_codes"].values()), {-signal.SIGKILL})

    def test_process_that_hangs_is_killed_in_the_end(self):
        self.behaviour["loop_closer"]["ignore"] = ["SIGINT", "SIGTERM"]
        self.out.mkdir()
        (self.out / "logs").mkdir()
        commands = {role.role: [str(self.bin / role.program), "--out", str(self.out)] for role in launch_arguments.ROLES}
        quick = ((signal.SIGINT, 0.1), (signal.SIGTERM, 0.1), (signal.SIGKILL, None))
        with mock.patch.object(launch_processes, "ENDING", quick), mock.patch.dict(os.environ, self.environment()), \
                mock.patch.object(launch_processes, "say") as say:
            supervisor = launch_processes.Supervisor(commands, self.out)
            self.assertEqual(supervisor.run(), 128 + signal.SIGKILL)
        self.assertEqual(supervisor.codes["loop_closer"], -signal.SIGKILL)
        self.assertIn("loop_closer did not end within 0 s: SIGKILL", [call.args[0] for call in say.call_args_list])


class RobotsTest(RunTest):
    def setUp(self):
        super().setUp()
        self.other_data = self.folder / "other_data"
        self.other_data.mkdir()
        # Six bytes of five back ends, three for each frontend: when both end, all are up.
        self.behaviour["atlas_server"]["announce"] = 2
        self.behaviour["frontend_tracker"]["others"] = 3
        # Held open, so that what was said stays in it from one frontend's end to the other's start.
        self.addCleanup(os.close, os.open(self.up, os.O_RDWR))

    def run_two(self, *arguments):
        return self.run_to_end("--robots", "2", "--data", str(self.other_data), *arguments)

    def arguments_in(self, folder, role):
        return json.loads((self.out / folder / f"{role}.arguments").read_text())

    def test_two_robots_share_one_atlas_server(self):
        code, errors = self.run_two("--set", "dds.partition=mine", "--domain", "17")
        self.assertEqual(code, 0, errors)
        roles_of_robots = ["backend_mapper", "loop_closer", "frontend_tracker"] * 2
        self.assertEqual(sorted(path.stem for path in self.out.glob("**/*.arguments")), sorted(["atlas_server", *roles_of_robots]))
        for number, data in ((0, self.other_data), (1, self.data)):
            arguments = self.arguments_in(f"robot_{number}", "frontend_tracker")
            self.assertEqual(arguments, ["--out", str(self.out / f"robot_{number}"), "--set", "dds.partition=fleet", "--set", "dds.partition=mine",
                                         "--robot", str(number), "--domain", "17", "--data", str(data), "--speed", "1"])
            self.assertEqual(self.arguments_in(f"robot_{number}", "backend_mapper")[-4:], ["--robot", str(number), "--domain", "17"])

    def test_figures_are_given_for_each_robot_and_together(self):
        code, errors = self.run_two("--robot", "5")
        self.assertEqual(code, 0, errors)
        summary = self.summary()
        self.assertEqual(set(summary["robots"]), {"robot_5", "robot_6"})
        self.assertEqual((summary["frames"], summary["tracked"]), (20, 18))
        back_ends = {f"robot_{number}/{role}" for number in (5, 6) for role in ("backend_mapper", "loop_closer", "frontend_tracker")}
        for key in ("cpu_s", "peak_memory_mb", "exit_codes"):
            self.assertEqual(set(summary[key]), {"atlas_server", *back_ends})
        self.assertEqual(summary["bytes_sent"]["keyframe"], 14)
        robot = json.loads((self.out / "robot_6" / "summary.json").read_text())
        self.assertEqual((robot["frames"], robot["data"]), (10, str(self.data)))
        self.assertIn("robot_5: 9 of 10 frames tracked", errors)

    def test_the_second_robot_starts_later(self):
        for folder in ("", "robot_0", "robot_1"):
            (self.out / folder / "logs").mkdir(parents=True)
        names = ["atlas_server", "robot_0/frontend_tracker", "robot_1/frontend_tracker"]
        supervisor = launch_processes.Supervisor({name: [sys.executable, "-c", ""] for name in names}, self.out, {names[2]: 0.3})
        started = []

        def start(name, command, out, process=launch_processes.Process):
            started.append((name, time.monotonic()))
            return process(name, command, out)

        with mock.patch.object(launch_processes, "Process", start), mock.patch.object(launch_processes, "say"):
            self.assertEqual(supervisor.run(), 0)
        self.assertEqual([name for name, _ in started], names)
        self.assertGreaterEqual(started[2][1] - started[1][1], 0.25)

    def test_interrupt_before_the_second_robots_start(self):
        self.behaviour["frontend_tracker"] = {"announce": True, "wait": "signal", "code": 130, "report": FRONTEND_REPORT}
        process = self.start("--robots", "2", "--data", str(self.other_data), "--start-offset", "600")
        self.wait_until_up(5)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=TIMEOUT_S)
        self.assertEqual(process.returncode, 130)
        self.assertFalse((self.out / "robot_1" / "frontend_tracker.arguments").exists())

    def test_a_robot_that_fails_leaves_the_other_and_its_code(self):
        self.behaviour["frontend_tracker"].update(code=2, say="no camera")
        code, errors = self.run_two()
        self.assertEqual(code, 2)
        self.assertIn("robot_0/frontend_tracker failed (code 2)", errors)
        self.assertIn("robot_1/frontend_tracker failed (code 2)", errors)


class SecurityTest(RunTest):
    def setUp(self):
        super().setUp()
        self.keys = self.folder / "keys"
        for role in (*BACK_ENDS, "frontend_tracker"):
            (self.keys / role).mkdir(parents=True)

    def test_every_process_is_given_the_keys(self):
        code, errors = self.run_to_end("--security", str(self.keys))
        self.assertEqual(code, 0, errors)
        for role in (*BACK_ENDS, "frontend_tracker"):
            arguments = self.arguments_of(role)
            self.assertEqual(arguments[arguments.index("--security") + 1], str(self.keys))

    def test_mixed_vendors_are_refused(self):
        code, errors = self.run_to_end("--security", str(self.keys), "--dds", "fastdds", "--dds-loop", "cyclonedds")
        self.assertEqual(code, launch_arguments.EXIT_USAGE)
        self.assertIn("different DDS vendors", errors)

    def test_keys_that_are_missing_are_named(self):
        (self.keys / "backend_mapper").rmdir()
        code, errors = self.run_to_end("--security", str(self.keys))
        self.assertEqual(code, launch_arguments.EXIT_USAGE)
        self.assertIn("holds no keys of backend_mapper", errors)


class AtlasTest(RunTest):
    def test_saved_atlas_goes_to_the_atlas_server_alone(self):
        saved = self.folder / "atlas.db"
        saved.write_text("")
        code, errors = self.run_to_end("--atlas", str(saved), "--domain", "17")
        self.assertEqual(code, 0, errors)
        self.assertEqual(self.arguments_of("atlas_server")[-2:], ["--store", str(saved)])
        for role in ("backend_mapper", "loop_closer", "frontend_tracker"):
            self.assertNotIn("--store", self.arguments_of(role))

    def test_a_run_begins_without_the_maps_of_an_earlier_one_which_are_kept(self):
        self.out.mkdir(exist_ok=True)
        for name in ("atlas.db", "atlas.db-wal"):
            (self.out / name).write_text(f"old {name}")
        code, errors = self.run_to_end()
        self.assertEqual(code, 0, errors)
        self.assertIn("atlas.db.before", errors)
        self.assertFalse((self.out / "atlas.db").exists())
        self.assertEqual((self.out / "atlas.db.before").read_text(), "old atlas.db")
        self.assertEqual((self.out / "atlas.db.before-wal").read_text(), "old atlas.db-wal")

    def test_an_atlas_in_out_that_is_to_be_gone_on_with_stays(self):
        self.out.mkdir(exist_ok=True)
        (self.out / "atlas.db").write_text("saved")
        code, errors = self.run_to_end("--atlas", str(self.out / "atlas.db"))
        self.assertEqual(code, 0, errors)
        self.assertEqual((self.out / "atlas.db").read_text(), "saved")


class ArgumentTest(RunTest):
    def assert_refused(self, text, *arguments, data=True):
        code, errors = self.run_to_end(*arguments, data=data)
        self.assertEqual(code, launch_arguments.EXIT_USAGE, errors)
        self.assertIn(text, errors)
        self.assertFalse(self.out.exists(), "something was made before the arguments were checked")

    def test_bad_arguments_are_refused_before_anything_starts(self):
        self.assert_refused("--data is needed", data=False)
        self.assert_refused("no such folder", "--data", str(self.folder / "none"), data=False)
        self.assert_refused("--speed 0:", "--speed", "0")
        self.assert_refused("--speed nan:", "--speed", "nan")
        self.assert_refused("--speed fast:", "--speed", "fast")
        self.assert_refused("opendds", "--dds", "opendds")
        self.assert_refused("--dds-loop", "--dds-loop", "x")
        self.assert_refused("--camera", "--camera", str(self.folder / "none.yaml"))
        self.assert_refused("--config", "--config", str(self.data))
        self.assert_refused("--set tracker", "--set", "tracker")
        self.assert_refused("--set =1", "--set", "=1")
        self.assert_refused("'tracker', expected some of", "--roles", "tracker")
        self.assert_refused("none given", "--roles", ",")
        self.assert_refused("--standby: the frontend can't stand by", "--standby")
        self.assert_refused("--standby: the frontend can't stand by", "--standby", "--roles", "mapper,frontend")
        self.assert_refused("--domain 231", "--domain", "231")
        self.assert_refused("--robot -1", "--robot", "-1")
        self.assert_refused("--atlas", "--atlas", str(self.folder / "none.db"))
        self.assert_refused("given 1 times for 2 robots", "--robots", "2")
        self.assert_refused("given 2 times for 1 robot", "--data", str(self.data))
        self.assert_refused("--robots 0", "--robots", "0")
        self.assert_refused("--robots: needs all roles", "--robots", "2", "--roles", "frontend")
        self.assert_refused("--start-offset -1.0", "--start-offset", "-1")
        self.assert_refused("--start-offset nan", "--start-offset", "nan")
        self.assert_refused("the last robot's number 65536", "--robots", "2", "--robot", "65535", "--data", str(self.data))
        self.assert_refused("run launch_scripts/build.sh", "--bin", str(self.data))

    def test_out_that_cannot_be_made_is_refused(self):
        self.out.write_text("a file")
        code, errors = self.run_to_end()
        self.assertEqual(code, launch_arguments.EXIT_USAGE)
        self.assertIn(f"--out {self.out}", errors)


class DomainTest(unittest.TestCase):
    def test_passes_over_domains_in_use(self):
        with mock.patch.object(launch_arguments, "is_domain_free", lambda domain: domain == 5):
            self.assertEqual(launch_arguments.derive_domain(4), 5)
            self.assertEqual(launch_arguments.derive_domain(100), 5)
        with mock.patch.object(launch_arguments, "is_domain_free", lambda domain: False):
            self.assertIn(launch_arguments.derive_domain(12345), range(1, 102))


class DescriptionTest(unittest.TestCase):
    def test_run_without_a_tracked_frame(self):
        summary = launch_summary.merge({"frontend_tracker": {**FRONTEND_REPORT, "frame_ms": {"median": None, "p95": None}}})
        self.assertIn("9 of 10 frames tracked", launch_summary.describe(summary))
        self.assertEqual(launch_summary.describe(launch_summary.merge({})), "no figures of the frontend")


class SummaryFileTest(unittest.TestCase):
    def test_full_disk_leaves_the_old_file_and_nothing_else(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "summary.json"
            path.write_text("{}")
            with mock.patch.object(os, "fsync", side_effect=OSError(errno.ENOSPC, "full")), self.assertRaises(OSError):
                launch_summary.write_json(path, {"frames": 1})
            self.assertEqual([file.name for file in path.parent.iterdir()], ["summary.json"])
            self.assertEqual(path.read_text(), "{}")


if __name__ == "__main__":
    unittest.main()
