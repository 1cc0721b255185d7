"""Data packets of a sensor as they were recorded: payloads, and times of reception."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.geometry.cloud import Floats

PACKET_BYTES = 1206


@dataclass(frozen=True)
class PacketLog:
    """Payloads (p, 1206) uint8 and reception times (p,), s since 1970, in the order recorded.

    about: counts of what was not a data packet, and what was cut off.
    """

    payloads: NDArray[np.uint8]
    received: Floats
    about: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.payloads)

    def between(self, start_s: float, end_s: float) -> PacketLog:
        """Packets received from `start_s` to before `end_s` seconds after the first one."""
        since = self.received - self.received[:1]
        rows = (since >= start_s) & (since < end_s)
        return PacketLog(self.payloads[rows], self.received[rows], self.about)


def joined(
    payloads: Sequence[bytes], received: Sequence[float], about: dict[str, Any]
) -> PacketLog:
    """A log of payloads of 1,206 bytes each."""
    data = np.frombuffer(b"".join(payloads), dtype=np.uint8).reshape(-1, PACKET_BYTES)
    return PacketLog(data, np.asarray(received, dtype=np.float64), about)
