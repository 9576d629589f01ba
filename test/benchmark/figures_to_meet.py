"""Figures to meet, and whether the medians of some runs meet them. A run's figures are a dictionary; None, or no entry: it has none."""

import dataclasses
import statistics


@dataclasses.dataclass(frozen=True)
class Limit:
    """Of the figure `key`, called `words` in a verdict. `is_worded`: these say the value too. `is_optional`: runs that have no such figure meet it."""

    key: str
    words: str
    value: float
    is_least: bool = False
    is_worded: bool = False
    is_optional: bool = False

    def is_met(self, measured):
        if measured is None:
            return self.is_optional
        return measured >= self.value if self.is_least else measured <= self.value

    def __str__(self):
        return f"{'≥' if self.is_least else '≤'} {self.value:g}"


def at_least(key, words, value, **more):
    return Limit(key, words, value, is_least=True, **more)


def at_most(key, words, value, **more):
    return Limit(key, words, value, **more)


def median(runs, key):
    """Of the runs that have the figure; None if none has."""
    values = [run[key] for run in runs if run.get(key) is not None]
    return statistics.median(values) if values else None


def done(runs):
    return [run for run in runs if "failure" not in run]


def verdict(limits, runs):
    """"met", what is missed, or "-" where nothing is to be met; and how many runs failed."""
    worked = done(runs)
    failed = f"{len(runs) - len(worked)} of {len(runs)} runs failed" if len(worked) < len(runs) else ""
    missed = [limit.words for limit in limits if not limit.is_met(median(worked, limit.key))] if worked else []
    words = "missed: " + ", ".join(missed) if missed else "met" if limits and worked else "-" if worked else ""
    return "; ".join(part for part in (words, failed) if part)


def list_limits(limits):
    """All of them in a cell."""
    return "; ".join(limit.words if limit.is_worded else f"{limit.words} {limit}" for limit in limits)


def show(value, digits):
    return "-" if value is None else f"{value:.{digits}f}"


def beside(text, limits, key):
    """A figure as a cell, beside the figure to meet if there is one for `key`."""
    return " ".join([text, *(f"({limit})" for limit in limits if limit.key == key)])
