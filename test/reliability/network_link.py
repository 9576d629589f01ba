"""Two machines on one: network namespaces joined by a relay between two TAP devices, which loses, delays and holds back what it carries. Needs root.

The kernel's own means (tc netem) are missing in many kernels of containers and small virtual machines; TAP devices are not.
"""

import collections
import dataclasses
import fcntl
import os
import random
import select
import struct
import subprocess
import threading
import time

ROBOT, RACK = "robot", "rack"
# Documentation addresses (RFC 5737): nobody's.
ADDRESSES = {ROBOT: "198.51.100.1", RACK: "198.51.100.2"}
PREFIX_LENGTH = 24
DEVICE = "link0"

TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000  # linux/if_tun.h
FRAME_BYTES = 65536
TX_QUEUE_FRAMES = 10000  # of the device: a burst of keyframes is not to be lost before it reaches the relay


def run(*command):
    """Output of a command; raises CalledProcessError, whose stderr tells why."""
    return subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True).stdout


def why_impossible():
    """Why there can be no two machines here, or None."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    try:
        with Link():
            return None
    except (OSError, subprocess.CalledProcessError) as error:
        return f"network namespaces can't be joined here: {getattr(error, 'stderr', None) or error}".strip()


@dataclasses.dataclass(frozen=True)
class Quality:
    """Of the link, in each direction."""

    delay_s: float = 0.0
    loss: float = 0.0              # share of the frames, at random
    bytes_per_s: float = 0.0       # 0: as fast as it goes
    buffer_bytes: int = 256 << 10  # of the router at a slow link: what finds it full is lost

    def describe(self):
        words = [f"{100 * self.loss:.0f} % loss"] * (self.loss > 0) + [f"{1e3 * self.delay_s:.0f} ms delay"] * (self.delay_s > 0)
        words += [f"{8e-6 * self.bytes_per_s:.0f} Mbit/s"] * (self.bytes_per_s > 0)
        return ", ".join(words) or "perfect"


class Direction:
    """Frames on their way from one device to the other, in order."""

    def __init__(self, source, target, seed):
        self.source, self.target = source, target
        self.random = random.Random(seed)
        self.waiting = collections.deque()  # (when it arrives, frame)
        self.held_bytes = 0
        self.free_at = 0.0                  # when the line has sent what was given to it
        self.bytes_offered = 0

    def take(self, quality, is_cut):
        """Reads all frames that the source has."""
        while True:
            try:
                frame = os.read(self.source, FRAME_BYTES)
            except BlockingIOError:
                return
            self.bytes_offered += len(frame)
            if is_cut or self.random.random() < quality.loss:
                continue
            now = time.monotonic()
            if quality.bytes_per_s > 0:
                if self.held_bytes + len(frame) > quality.buffer_bytes:
                    continue
                self.free_at = max(now, self.free_at) + len(frame) / quality.bytes_per_s
                now = self.free_at
            self.held_bytes += len(frame)
            self.waiting.append((now + quality.delay_s, frame))

    def deliver(self, is_cut):
        """Hands over what has arrived. Returns the seconds until the next one, or None."""
        now = time.monotonic()
        while self.waiting and self.waiting[0][0] <= now:
            frame = self.waiting.popleft()[1]
            self.held_bytes -= len(frame)
            try:
                if not is_cut:
                    os.write(self.target, frame)
            except OSError:
                pass  # the device is going down
        return max(0.0, self.waiting[0][0] - now) if self.waiting else None


class Link:
    """The two namespaces while the context lasts. What was started in them has to end before.

      with Link() as link:
          subprocess.Popen(link.command(ROBOT, ["hostname"]))
          link.cut(); link.restore(); link.quality = Quality(delay_s=0.01, loss=0.02)
    """

    def __init__(self, seed=1):
        self.seed = seed
        self.quality = Quality()
        self._is_cut = False
        self._names = {host: f"portolan{os.getpid()}_{host}" for host in (ROBOT, RACK)}
        self._devices, self._directions = {}, {}
        self._wake_reader, self._wake_writer = os.pipe2(os.O_CLOEXEC)
        self._relay = threading.Thread(target=self._carry, daemon=True)

    def __enter__(self):
        try:
            for host in (ROBOT, RACK):
                self._make(host)
        except BaseException:
            self._remove()
            raise
        for index, (host, other) in enumerate(((ROBOT, RACK), (RACK, ROBOT))):
            self._directions[host] = Direction(self._devices[host], self._devices[other], self.seed + index)
        self._relay.start()
        return self

    def __exit__(self, *_):
        os.write(self._wake_writer, b"x")
        self._relay.join()
        self._remove()

    def command(self, host, command):
        """The command line that runs `command` on a host."""
        return ["ip", "netns", "exec", self._names[host], *command]

    def cut(self):
        """As a radio link ends: the devices stay up, and nothing arrives."""
        self._is_cut = True

    def restore(self):
        self._is_cut = False

    def bytes_sent(self, host):
        """What the host has sent over the link, headers included, lost or not."""
        return self._directions[host].bytes_offered

    def _make(self, host):
        name, made = self._names[host], f"port{os.getpid()}{host[:2]}"[-15:]
        run("ip", "netns", "add", name)
        device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        self._devices[host] = device
        fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH22x", made.encode(), IFF_TAP | IFF_NO_PI))
        run("ip", "link", "set", made, "netns", name, "name", DEVICE, "txqueuelen", TX_QUEUE_FRAMES)
        run("ip", "-n", name, "address", "add", f"{ADDRESSES[host]}/{PREFIX_LENGTH}", "dev", DEVICE)
        for up in ("lo", DEVICE):
            run("ip", "-n", name, "link", "set", up, "up")
        run("ip", "-n", name, "route", "add", "224.0.0.0/4", "dev", DEVICE)

    def _remove(self):
        for device in self._devices.values():
            os.close(device)
        self._devices.clear()
        for end in (self._wake_reader, self._wake_writer):
            os.close(end)
        for name in self._names.values():
            subprocess.run(["ip", "netns", "del", name], check=False, stderr=subprocess.DEVNULL)

    def _carry(self):
        directions = list(self._directions.values())
        while True:
            waits = [wait for wait in (direction.deliver(self._is_cut) for direction in directions) if wait is not None]
            readable, _, _ = select.select([self._wake_reader, *(d.source for d in directions)], [], [], min(waits, default=None))
            if self._wake_reader in readable:
                return
            for direction in directions:
                if direction.source in readable:
                    direction.take(self.quality, self._is_cut)
