"""Which maps the tracker was in, frame by frame, and which frames have texture: from trajectory_online.txt and the sequence. Frames count from 0, maps from 1.

A map that was fused is not seen in it: its frames are those of the map it went into.
"""

import bisect
import math

from sequence_runs import frame_seconds

# Frames without texture in sequences that do not say so themselves (shared/data/README.md).
BLACK = {"blackout": range(247, 259)}
# The frame with which the tracker gives its map up is the sixth that it can't track: black ones before it are not between loss and the next map.
FRAMES_TO_LOSS = 6
MAX_DT_S = 0.002  # between a frame's time in the sequence and in a trajectory


def black_frames(folder):
    """Those without texture: make_sequence.py notes the ones it put in."""
    source = folder / "source_frames.txt"
    if source.is_file():
        return {frame for frame, line in enumerate(source.read_text().splitlines()) if line.split()[1] == "-"}
    return set(BLACK.get(folder.name, ()))


class Frames:
    """Of a sequence, by time."""

    def __init__(self, folder):
        self.seconds, self.black = frame_seconds(folder), black_frames(folder)

    def at(self, seconds):
        """Number of the frame at that time; None if there is none."""
        after = bisect.bisect_left(self.seconds, seconds)
        near = min((i for i in (after - 1, after) if 0 <= i < len(self.seconds)), key=lambda i: abs(self.seconds[i] - seconds), default=None)
        return near if near is not None and abs(self.seconds[near] - seconds) <= MAX_DT_S else None

    def num_textured(self):
        return len(self.seconds) - len(self.black)

    def textured(self, trajectory):
        """How many frames with texture have a pose."""
        return len({frame for frame, _ in self.rows(trajectory)} - self.black)

    def rows(self, trajectory):
        """[(frame, fields of the line)] in the order of time, of TUM lines."""
        if not trajectory.is_file():
            return []
        fields = [line.split() for line in trajectory.read_text().splitlines() if line.strip() and not line.startswith("#")]
        found = [(self.at(float(words[0])), words) for words in fields]
        return sorted(((frame, words) for frame, words in found if frame is not None), key=lambda one: one[0])

    def visits(self, trajectory, first=0, last=math.inf):
        """[(frame, map)] each time that the tracker was in another map than before, from the frame `first` up to `last`."""
        visits = []
        for frame, words in self.rows(trajectory):
            if first <= frame <= last and (not visits or visits[-1][1] != int(words[8]) + 1):
                visits.append((frame, int(words[8]) + 1))
        return visits


def in_words(visits):
    """"1 2 3 1"; "-" for none."""
    return " ".join(str(one) for _, one in visits) or "-"


def begun_from(visits, frame):
    """Maps that the tracker was in for the first time at the frame or later."""
    return {one for _, one in visits} - {one for first, one in visits if first < frame}


def returns_to_first(visits, frame):
    """Whether it came back into the first map it was in, at the frame or later."""
    return any(first >= frame and one == visits[0][1] for first, one in visits[1:])


def textured_frames_to_new_map(frames_to_new_map, num_black):
    """The most frames with texture from a loss to the first pose in a new map; None without a loss. Black frames, all in a row, lie in the longest."""
    ordered = sorted(frames_to_new_map)
    if not ordered:
        return None
    ordered[-1] = max(0, ordered[-1] - max(0, num_black - FRAMES_TO_LOSS))
    return max(ordered)
