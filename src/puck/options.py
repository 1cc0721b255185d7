"""Options of the encoders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from pointkit.errors import InputError

Effort = Literal["fast", "normal", "thorough"]
EFFORTS: tuple[Effort, ...] = get_args(Effort)
MAX_STEP = 1 << 12


@dataclass(frozen=True)
class CodingOptions:
    """Options that say what an encoder keeps and how much time it takes.

    With the defaults, nothing is lost.

    Parameters
    ----------
    step
        Quantisation step of the ranges, in quanta, i.e. in the sensor's range units. 1 loses
        nothing.
    lmbda
        Weight of a range's cost in nats against its squared error in squared quanta, rounded to
        sixteenths. Above 0, the encoder may choose the multiple of `step` next to the nearest one
        if this saves enough bits.
    times, reflectivities
        Whether times and reflectivities are encoded. If not, decoded turns have None in their
        place.
    effort
        ``fast``, ``normal`` or ``thorough``. Larger models compress better and take longer.
    key_every
        Number of turns from one key turn to the next; a key turn can be decoded without the turns
        before it. With 0, only the first turn is a key turn.

    Raises
    ------
    InputError
        An option is out of its range.
    """

    step: int = 1
    lmbda: float = 0.0
    times: bool = True
    reflectivities: bool = True
    effort: Effort = "normal"
    key_every: int = 50

    def __post_init__(self) -> None:
        if not 1 <= self.step <= MAX_STEP:
            raise InputError(f"step {self.step} (1 to {MAX_STEP})")
        if not 0 <= self.lmbda <= MAX_STEP**2:
            raise InputError(f"lambda {self.lmbda} (0 to {MAX_STEP**2})")
        if self.key_every < 0:
            raise InputError(f"key_every {self.key_every} is below 0")
        if self.effort not in EFFORTS:
            raise InputError(f"effort '{self.effort}' (one of {', '.join(EFFORTS)})")
