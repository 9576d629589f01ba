"""network.py: its parts, and one run on two machines where namespaces can be made."""

import argparse
import contextlib
import io
import json
import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

import network
import network_link
import report_section
from network import report_table
from network_link import RACK, ROBOT, Quality

IMPOSSIBLE = network_link.why_impossible()
SEQUENCE, BIN = os.environ.get("PORTOLAN_TEST_SEQUENCE"), os.environ.get("PORTOLAN_INSTALLED_BIN")
ECHO = f"""
import socket
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(("{network_link.ADDRESSES[RACK]}", 5000))
print("up", flush=True)
while True:
    data, sender = s.recvfrom(65536)
    s.sendto(data, sender)
"""
# Arguments: bytes of a datagram, how many. Prints how many came back, and the shortest way there and back in seconds.
PING = f"""
import socket, sys, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.settimeout(0.5)
times = []
for _ in range(int(sys.argv[2])):
    begin = time.monotonic()
    s.sendto(bytes(int(sys.argv[1])), ("{network_link.ADDRESSES[RACK]}", 5000))
    try:
        s.recvfrom(65536)
        times.append(time.monotonic() - begin)
    except TimeoutError:
        pass
print(len(times), min(times, default=0))
"""


HASHES = {role: {"1": "a"} for role in ("tracker", "atlas_server", "loop_closer")}


def result(**figures):
    """Of a run in which all went well."""
    return {"case": "test", "text": "a test", "codes": (0, 0), "problems": [], "frames": 1200, "tracked": 1170, "dropped": 3, "frame_p95_ms": 30.0,
            "maps": 1, "ate": 0.02, "keyframe_bytes": 42000, "keyframes_per_s": 2.5, "up": [1e5, 2e5], "down": [5e4],
            "sent_again": 0, "given_up": 0, "unacknowledged": 0, "memory_mb": 50.0, "memory_grew_mb": 7.0, "tracked_during": 1.0, "hashes": HASHES, **figures}


class DirectionTest(unittest.TestCase):
    """The relay between two socket pairs, without devices."""

    def setUp(self):
        self.sender, source = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        target, self.receiver = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        for end in (self.sender, source, target, self.receiver):
            self.addCleanup(end.close)
            end.setblocking(False)
        self.ends = (source, target)
        self.direction = network_link.Direction(source.fileno(), target.fileno(), seed=1)

    def pass_on(self, count, quality, is_cut=False):
        """Frames of 100 bytes, and how many of them come out at once."""
        for _ in range(count):
            self.sender.send(bytes(100))
            self.direction.take(quality, is_cut)
        self.direction.deliver(is_cut)
        arrived = 0
        while True:
            try:
                arrived += len(self.receiver.recv(200)) // 100
            except BlockingIOError:
                return arrived

    def test_a_perfect_link_delivers_all(self):
        self.assertEqual(self.pass_on(5, Quality()), 5)
        self.assertEqual(self.direction.bytes_offered, 500)

    def test_a_cut_link_delivers_nothing_and_counts_all(self):
        self.assertEqual(self.pass_on(5, Quality(), is_cut=True), 0)
        self.assertEqual(self.direction.bytes_offered, 500)

    def test_loses_its_share(self):
        arrived = sum(self.pass_on(1, Quality(loss=0.2)) for _ in range(1000))
        self.assertTrue(740 < arrived < 860, arrived)  # five sigma

    def test_delays(self):
        self.assertEqual(self.pass_on(3, Quality(delay_s=1000)), 0)
        self.assertGreater(self.direction.deliver(False), 900)

    def test_a_slow_link_holds_back_and_loses_what_its_buffer_cannot_take(self):
        self.assertEqual(self.pass_on(9, Quality(bytes_per_s=0.1, buffer_bytes=500)), 0)
        self.assertEqual((len(self.direction.waiting), self.direction.held_bytes), (5, 500))


class TableTest(unittest.TestCase):
    def test_maps_are_the_same_where_both_replicas_have_the_trackers_hash(self):
        hashes = {"tracker": {"1": "a", "2": "b"}, "atlas_server": {"1": "a", "2": "b", "3": "c"}, "loop_closer": {"1": "a", "2": "x"}}
        self.assertEqual(network.same_maps(hashes), (1, 2))

    def test_every_case_has_its_own_name_and_text(self):
        for words in ([case.name for case in network.CASES], [case.text for case in network.CASES]):
            self.assertEqual(len(set(words)), len(words))

    def test_a_row_has_a_cell_for_each_column(self):
        cells = dict(zip(network.COLUMNS, network.row(result()), strict=True))
        names = ("tracked", "keyframes/s", "kB a keyframe", "up kB/s (most)", "given up", "tracker MB (grew)", "far side has")
        self.assertEqual([cells[name] for name in names], ["1170 of 1200", "2.5", "42.0", "150 (200)", "0", "50 (7)", "all"])
        failed = network.row(result(frames=None, problems=["no figures"]))
        self.assertEqual((len(failed), failed[1]), (len(network.COLUMNS), "failed: no figures"))


class FollowTest(unittest.TestCase):
    def follow(self, case):
        """A run of four samples, of which the first comes before the first frame; the phases and what was done to the link."""
        link, watch, robot = unittest.mock.Mock(), unittest.mock.Mock(), unittest.mock.Mock()
        robot.child.poll.side_effect = [None] * 4 + [0]
        type(robot).progress = unittest.mock.PropertyMock(side_effect=[(0, "")] + [(i, "tracking") for i in range(1, 9)])
        with unittest.mock.patch.object(network, "SAMPLE_S", 0):
            network.follow(link, case, watch, robot, argparse.Namespace(timeout=60, verbose=False))
        return [call.args[0] for call in watch.take.call_args_list], [call[0] for call in link.method_calls]

    def test_a_link_is_cut_and_restored_in_its_time(self):
        phases, done = self.follow(network.Case("test", "a cut", cut_at_s=0, cut_s=1e-9))
        self.assertEqual((phases, done), (["before", "before", "during", "after"], ["cut", "restore"]))

    def test_without_a_cut_growth_is_from_the_same_moment_on(self):
        self.assertEqual(self.follow(network.Case("test", "slow", cut_at_s=0)), (["before", "before", "during", "during"], []))

    def test_seconds_count_from_the_first_frame(self):
        watch = network.Watch(None, None, None)
        self.assertEqual(watch.seconds(), 0)
        watch.samples = [(moment, "before", 0, 0, {}, (frame, "")) for moment, frame in ((10, 0), (11, 3), (12, 30), (15, 90))]
        self.assertEqual(watch.seconds(), 4)


class FiguresTest(unittest.TestCase):
    """From what the processes left to a row."""

    def figures(self, summary, tracker, back_end):
        watch = network.Watch(None, None, None)
        for moment, phase, frame, up, memory in ((0, "before", 0, 0, 40), (10, "before", 1, 0, 45), (20, "during", 300, 9e5, 48), (30, "during", 600, 2e6, 47)):
            watch.samples.append((moment, phase, up, 0, {"frontend_tracker": memory}, (frame, "tracking")))
        robot, rack = unittest.mock.Mock(), unittest.mock.Mock()
        robot.report.side_effect = lambda name: {"summary": summary, "frontend_tracker": tracker}[name]
        rack.report.side_effect = lambda name: back_end
        with tempfile.TemporaryDirectory() as folder:
            options = argparse.Namespace(out=pathlib.Path(folder), data=pathlib.Path(folder), bin=pathlib.Path(folder))
            (options.out / "test").mkdir()
            found = network.figures(network.Case("test", "a test"), options, watch, robot, rack, (0, 0))
            self.assertEqual(json.loads((options.out / "test" / "figures.json").read_text())["problems"], found["problems"])
        return found

    def test_keyframes_a_second_and_growth_count_from_their_moments(self):
        hashes = {"map_hash": {"1": "a"}}
        found = self.figures({"frames": 600, "tracked": 590, "dropped": 2, "maps": 1, "bytes_per_keyframe": 42000, "frame_ms": {"p95": 30}},
                             {"keyframes_sent": 50, "keyframes_given_up": 0, "keyframes_unacknowledged": 0, "keyframes_sent_again": 0, **hashes}, hashes)
        self.assertEqual((found["keyframes_per_s"], found["memory_grew_mb"], found["problems"]), (2.5, 3, []))
        self.assertEqual(len(network.row(found)), len(network.COLUMNS))

    def test_a_run_that_left_nothing_has_a_row(self):
        found = self.figures({}, {}, {})
        self.assertEqual((found["keyframes_per_s"], found["problems"]), (None, ["no figures"]))
        self.assertEqual(len(network.row(found)), len(network.COLUMNS))


class ProblemsTest(unittest.TestCase):
    def problems(self, case=network.Case("test", "a test"), undisturbed=0.0, **figures):
        return network.find_problems(case, result(**figures), undisturbed)

    def test_a_good_run_has_none(self):
        self.assertEqual(self.problems(), [])

    def test_processes_that_failed_and_keyframes_that_stayed_behind(self):
        self.assertEqual(self.problems(codes=(0, 3)), ["exit code 3 of the rack"])
        self.assertEqual(self.problems(frames=None), ["no figures"])
        self.assertEqual(self.problems(unacknowledged=2), ["2 keyframes without answer"])
        self.assertEqual(self.problems(given_up=4), ["4 keyframes given up"])
        self.assertEqual(self.problems(hashes={**HASHES, "loop_closer": {"1": "b"}}), ["0 of 1 maps are the same on both sides"])

    def test_the_trackers_rate_is_harmed_by_more_drops_than_undisturbed(self):
        self.assertEqual(self.problems(dropped=12), [])
        self.assertEqual(self.problems(dropped=13), ["1.1 % of the frames dropped"])
        self.assertEqual(self.problems(dropped=24, undisturbed=0.02), [])

    def test_memory_may_grow_by_what_is_kept(self):
        self.assertEqual(self.problems(memory_grew_mb=52), [])
        self.assertEqual(self.problems(memory_grew_mb=53), ["the tracker's memory grew by 53 MB, 52 expected at most"])
        self.assertEqual(self.problems(memory_grew_mb=80, keyframe_bytes=84000), [])
        self.assertEqual(self.problems(memory_grew_mb=None), [])

    def test_a_cut_is_tracked_through_but_not_when_a_process_stands_still(self):
        self.assertEqual(self.problems(network.Case("test", "a cut", cut_s=5), tracked_during=0.8), ["tracking in 80 % of the cut"])
        self.assertEqual(self.problems(network.Case("test", "a stop", cut_s=5, stopped="loop_closer"), tracked_during=0.8), [])

    def test_what_undisturbed_runs_dropped_is_in_their_results(self):
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder)
            self.assertEqual(network.undisturbed_drops(out), 0)
            for name, dropped in (("multicast_fast_cyclone", 30), ("peers_fast_cyclone", 6), ("slow_fast_fast", 600), ("cut_5s_fast_cyclone", 600)):
                (out / name).mkdir()
                (out / name / "figures.json").write_text(json.dumps(result(dropped=dropped)))
            self.assertEqual(network.undisturbed_drops(out), 0.025)


class DocumentTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.page = pathlib.Path(folder.name) / "page.md"
        begin, end = report_section.markers(network.SECTION)
        old = ("case", "tracked", "maps", "far side has")
        rows = (["8 Mbit/s, fast to fast", "1167 of 1200", "1", "all"], ["a case of old", "1", "1", "all"],
                ["fast to cyclone, static peers", "1170 of 1200", "1", "all"])
        self.page.write_text("\n".join(["above", begin, report_table.head(old), *map(report_table.line, rows), end, "below", ""]))

    def rows(self):
        return report_table.read(self.page.read_text())

    def test_rows_of_other_cases_stay_with_the_columns_they_have(self):
        network.document(self.page, [network.row(result(text="8 Mbit/s, fast to fast", tracked=1111))])
        rows = self.rows()
        self.assertEqual([row["case"] for row in rows], ["fast to cyclone, static peers", "8 Mbit/s, fast to fast"])
        self.assertEqual([row["tracked"] for row in rows], ["1170 of 1200", "1111 of 1200"])
        self.assertEqual([row["keyframes/s"] for row in rows], ["-", "2.5"])

    def test_a_new_case_comes_in_its_place_and_the_page_around_stays(self):
        for text in ("fast to cyclone, multicast", "loop_closer stands still for 70 s, fast"):
            network.document(self.page, [network.row(result(text=text))])
        self.assertEqual([row["case"] for row in self.rows()], ["fast to cyclone, multicast", "fast to cyclone, static peers", "8 Mbit/s, fast to fast",
                                                                "loop_closer stands still for 70 s, fast"])
        lines = self.page.read_text().splitlines()
        self.assertEqual((lines[0], lines[-1]), ("above", "below"))
        self.assertIn("## Two machines", lines)

    def test_a_page_without_the_section_is_refused_before_anything_runs(self):
        self.page.write_text("# Page\n")
        with contextlib.redirect_stderr(io.StringIO()) as errors, self.assertRaises(SystemExit):
            network.parse(["--document", str(self.page)])
        self.assertIn("expected the line '<!-- begin: two machines (test/reliability/network.py) -->' once", errors.getvalue())


@unittest.skipIf(IMPOSSIBLE, IMPOSSIBLE)
class LinkTest(unittest.TestCase):
    def ping(self, link, size, count):
        output = subprocess.run(link.command(ROBOT, [sys.executable, "-c", PING, str(size), str(count)]), check=True, capture_output=True, text=True).stdout
        arrived, shortest = output.split()
        return int(arrived), float(shortest)

    def test_joins_two_machines_and_can_be_spoiled(self):
        with network_link.Link() as link:
            echo = subprocess.Popen(link.command(RACK, [sys.executable, "-c", ECHO]), stdout=subprocess.PIPE)
            self.addCleanup(echo.stdout.close)
            self.addCleanup(echo.kill)
            echo.stdout.readline()
            self.assertEqual(self.ping(link, 60000, 5)[0], 5)  # in fragments
            link.quality = Quality(delay_s=0.05)
            arrived, shortest = self.ping(link, 100, 5)
            self.assertEqual(arrived, 5)
            self.assertGreater(shortest, 0.1)
            link.cut()
            self.assertEqual(self.ping(link, 100, 1)[0], 0)
            link.restore()
            self.assertEqual(self.ping(link, 100, 5)[0], 5)
            self.assertGreater(link.bytes_sent(ROBOT), 5 * 60000)
            echo.kill()
            echo.wait()


@unittest.skipIf(IMPOSSIBLE, IMPOSSIBLE)
@unittest.skipUnless(SEQUENCE and BIN, "PORTOLAN_TEST_SEQUENCE and PORTOLAN_INSTALLED_BIN name no rendered sequence and no programs")
class RunTest(unittest.TestCase):
    """Vendors mixed, the link cut in the middle: afterwards both sides hold the same map, and no keyframe is without answer."""

    def test_a_cut_link_loses_nothing(self):
        with tempfile.TemporaryDirectory() as folder:
            options = network.parse(["--data", SEQUENCE, "--bin", BIN, "--out", folder, "--speed", "0.2", "--timeout", "120"])
            options.out.mkdir(exist_ok=True)
            case = network.Case("test", "a short cut", ("cyclonedds", "fastdds"), cut_at_s=12, cut_s=3)
            with network_link.Link() as link:
                result = network.play(link, case, options)
            logs = "\n".join(log.read_text(errors="replace") for log in pathlib.Path(folder).glob("test/*/logs/*.log"))
        self.assertEqual(result["codes"], (0, 0), logs)
        self.assertEqual(result["unacknowledged"], 0, logs)
        self.assertEqual(network.same_maps(result["hashes"]), (1, 1), logs)
        self.assertGreater(result["tracked"], 0.6 * result["frames"], logs)  # the map begins after a quarter
        self.assertGreater(result["keyframe_bytes"], 0)


if __name__ == "__main__":
    unittest.main()
