"""network.py: its parts, and one run on two machines where namespaces can be made."""

import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import unittest

import network
import network_link
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

    def test_the_section_is_replaced_and_the_rest_stays(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "page.md"
            path.write_text("# Page\n\nabove\n")
            network.document(path, ["first"])
            with open(path, "a", encoding="utf-8") as file:
                file.write("\nbelow\n")
            network.document(path, ["second", "third"])
            self.assertEqual(path.read_text(), "# Page\n\nabove\n\n<!-- network begin -->\nsecond\nthird\n<!-- network end -->\n\nbelow\n")

    def test_every_case_has_its_own_name(self):
        names = [case.name for case in network.CASES]
        self.assertEqual(len(set(names)), len(names))


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
