"""What a script of this folder gives to `make measure`: rows, and what it needs to measure them.

Each has a function ``measure(inputs: Inputs) -> Iterator[Row]``, which yields a row as soon as it
is measured; `benchmarks.performance.measure` lists these functions.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path


class MissingProgramError(Exception):
    """A rival that a script needs was not given; the text says how to give it."""


@dataclass(frozen=True)
class Inputs:
    """What the scripts measure with.

    Parameters
    ----------
    programs
        Paths of rivals, by the name of their variable of make: ``TMC3``, ``PC_ERROR``.
    recordings
        Packet captures and ROS bags.
    is_trial
        Whether to measure the least that runs through every line, for tests.
    """

    programs: Mapping[str, str] = field(default_factory=dict)
    recordings: Sequence[Path] = ()
    is_trial: bool = False

    def program(self, name: str) -> str:
        """Return the path of a rival's program, by its name in `programs`.

        Raises
        ------
        MissingProgramError
            It was not given. `make measure` then leaves the script's subject as it was.
        """
        if not self.programs.get(name):
            raise MissingProgramError(f"needs {name}=/path/to/{name.lower()}")
        return self.programs[name]

    def repeats(self, number: int) -> int:
        """Return the number of repeats: the given one, or one in a trial."""
        return 1 if self.is_trial else number


@dataclass(frozen=True)
class Row:
    """One measured value, beside that of a rival.

    Parameters
    ----------
    what
        What was done with what, most general first: ``office, ctc, scale 1: encode``.
    value, unit
        The value; in units such as ``s``, ``processor s``, ``MiB``, ``bytes``, ``x real time``.
    rival, rival_value
        Name of another program or method, and its value in the same unit; none if empty.
    at_most, at_least
        The aim for the ratio of `value` to `rival_value` or, without a rival, for `value`.
    repeats
        Number of runs of which the value is the best.
    """

    what: str
    value: float
    unit: str
    rival: str = ""
    rival_value: float | None = None
    at_most: float | None = None
    at_least: float | None = None
    repeats: int = 1

    @property
    def ratio(self) -> float | None:
        """The value relative to the rival's; None without a rival, or one that took no time."""
        return self.value / self.rival_value if self.rival_value else None

    @property
    def is_met(self) -> bool | None:
        """Whether the aim is met; None without an aim."""
        reached = self.ratio if self.rival else self.value
        if reached is None or self.at_most is self.at_least is None:
            return None
        return (self.at_most is None or reached <= self.at_most) and (
            self.at_least is None or reached >= self.at_least
        )

    def __str__(self) -> str:
        against = "" if self.ratio is None else f", {self.ratio:.3f} of {self.rival}'s"
        aim = {None: "", True: ", aim met", False: ", aim missed"}[self.is_met]
        return f"{self.what}: {number_text(self.value)} {self.unit}{against}{aim}"


def number_text(value: float) -> str:
    """Return a whole number with all its digits, and any other with three or four."""
    return f"{value:,.0f}" if value == int(value) or value >= 1000 else f"{value:.3g}"


def least_seconds(call: Callable[[], object], repeats: int) -> float:
    """Return the least processor time, s, of repeated calls; there is one call at least."""
    seconds = []
    for _ in range(max(repeats, 1)):
        start = time.process_time()
        call()
        seconds.append(time.process_time() - start)
    return min(seconds)
