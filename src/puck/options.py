from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from pointkit.errors import InputError

Effort = Literal["fast", "normal", "thorough"]
EFFORTS: tuple[Effort, ...] = get_args(Effort)
MAX_STEP = 1 << 12


@dataclass(frozen=True)
class CodingOptions:
    """Options for encoding turns; the defaults are lossless.

    Parameters
    ----------
    step
        Ranges are coded as multiples of this number of quanta (sensor steps); 1 is lossless.
    lmbda
        Lagrangian weight of the rate in nats against the squared error in quanta squared, rounded
        to sixteenths. If above 0, a multiple beside the nearest one may be coded to save bits.
    times, reflectivities
        Whether they are encoded.
    effort
        Size of the models: larger ones compress better and take longer.
    key_every
        Turns from one key turn (decodable alone) to the next; 0: only the first is a key turn.
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
