"""A codec under check, with the clouds that it is called with and what it makes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.checks import clouds
from puckbench.checks.opened_files import recorded_files
from puckbench.checks.registry import LeftOut
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.coding import decoded, encoded
from puckbench.codecs.learned import LearnedByLambda
from puckbench.codecs.rates import metric_rates, scaled_rates
from puckbench.geometry.attributes import RETURNS

if TYPE_CHECKING:
    from puckbench.checks.elsewhere import Elsewhere

Kind = Literal["scaled", "metric", "returns"]
"""Clouds that a codec is called with: scaled to a cube, in metres, or with a sensor's returns."""
KINDS: tuple[Kind, ...] = ("scaled", "metric", "returns")
_KNOWN = {
    "scaled": CloudKind("scaled"),
    "metric": CloudKind("metric"),
    "returns": CloudKind("metric", has_returns=True, has_packets=True),
}


def kinds_of(codec: Codec) -> list[Kind]:
    """Return the kinds of clouds that a codec codes."""
    return [kind for kind in KINDS if rates_for(codec, kind)]


def rates_for(codec: Codec, kind: Kind) -> list[str]:
    """Return the names of the rates at which a codec codes clouds of a kind."""
    if kind == "returns" and RETURNS not in codec.attributes:
        return []
    table = scaled_rates(codec.rates) if kind == "scaled" else metric_rates(codec.rates)
    return [rate for rate in table if codec.skip(_KNOWN[kind], rate) is None]


def estimates(codec: Codec) -> bool:
    """Return whether a codec decodes an estimate of the surface, and promises no distance.

    A neural network draws surfaces like those that it has seen, and denoising rounds edges off. A
    class of the user says so by its attribute ``estimates``.
    """
    return isinstance(codec, LearnedByLambda) or bool(getattr(codec, "estimates", False))


class Subject:
    """A codec under check.

    Parameters
    ----------
    codec
        The codec, ready to code.
    kind
        The clouds that it is called with.
    entry
        What a configuration says about the codec.
    """

    def __init__(self, codec: Codec, kind: Kind, entry: Mapping[str, Any] | None = None) -> None:
        self.codec, self.kind, self.entry = codec, kind, dict(entry or {})
        self.rates, self.estimates = rates_for(codec, kind), estimates(codec)
        self.written: set[Path] = set()
        """Files that the codec opened for writing while it encoded."""

    @property
    def finest(self) -> str:
        """Name of the rate with most bits."""
        return self.rates[-1]

    @property
    def unit(self) -> float:
        """Length of a grid step of `clouds`, in units of this subject's clouds."""
        return 1.0 if self.kind == "scaled" else 1 / clouds.UNITS_PER_METRE

    def of(self, points: Floats, **more: Any) -> PointCloud:
        """Return points (n, 3), in grid steps, as a cloud; `more` are attributes of the cloud."""
        if self.kind == "returns":
            raise LeftOut("needs a cloud of free points, and the codec codes returns")
        size = clouds.SIDE if self.kind == "scaled" else 0
        return PointCloud(points * self.unit, about={"size": size}, **more)

    def surface(self, points: int = 4000) -> PointCloud:
        """Return about so many points of a surface."""
        if self.kind == "returns":
            returns = clouds.room_returns(max(1, points // 384))
            return PointCloud(returns.points(), returns=returns, about={"size": 0})
        is_usual = points == 4000 and self.estimates
        return self.of(clouds.dense_surface() if is_usual else clouds.surface(points))

    def encode(self, cloud: PointCloud, rate: str, work: Any = None) -> bytes:
        """Encode a cloud as a run does."""
        with recorded_files() as opened:
            stream = encoded(self.codec, cloud, rate, work)
        self.written |= {file for file, is_written in opened.items() if is_written}
        return stream

    def decode(self, stream: bytes) -> PointCloud:
        """Decode a stream as a run does."""
        return decoded(self.codec, stream)

    @cached_property
    def cloud(self) -> PointCloud:
        """The cloud of most checks."""
        return self.surface()

    @cached_property
    def streams(self) -> dict[str, bytes]:
        """Streams of `cloud` by rate, made as in a run."""
        work = self.codec.prepare(self.cloud)
        return {rate: self.encode(self.cloud, rate, work) for rate in self.rates}

    @cached_property
    def decoded(self) -> dict[str, PointCloud]:
        """Decoded clouds of `streams` by rate."""
        return {rate: self.decode(stream) for rate, stream in self.streams.items()}

    @cached_property
    def random(self) -> PointCloud:
        """Points at random, of which is known how many bits they need."""
        return self.of(clouds.random_points())

    @cached_property
    def random_stream(self) -> bytes | None:
        """The stream of `random` at the finest rate, or None for a codec of returns."""
        return None if self.kind == "returns" else self.encode(self.random, self.finest)

    @cached_property
    def elsewhere(self) -> Elsewhere:
        """What a new process decodes of the streams."""
        from puckbench.checks.elsewhere import ask_elsewhere

        return ask_elsewhere(self)

    @cache  # noqa: B019 (a subject lives as long as its process)
    def tolerance(self) -> float:
        """Return the error that the finest rate may have on any cloud of this size.

        It is twice the error on `cloud`, and at least a hundredth of a grid step.
        """
        error = farthest_of_both(self.cloud.xyz, self.decoded[self.finest].xyz)
        return max(2 * error, 0.01 * self.unit)


def farthest_of_both(a: Floats, b: Floats) -> float:
    """Return the largest distance of a point of one cloud from the nearest point of the other.

    `a` and `b` have the shapes (n, 3) and (m, 3).
    """
    from puckbench.geometry.matching import farthest

    return max(farthest(a, b), farthest(b, a))


def ordered(points: Floats) -> Floats:
    """Return points (n, 3) in an order that does not depend on theirs."""
    return points[np.lexsort(points.T)]


def single_return() -> PointCloud:
    """Return a cloud with one return."""
    returns = clouds.room_returns(1)
    (turn,) = returns.turns
    ranges = np.zeros_like(turn.ranges)
    ranges[0, 5, 3] = turn.ranges.max()
    returns = replace(returns, turns=(replace(turn, ranges=ranges),))
    return PointCloud(returns.points(), returns=returns, about={"size": 0})
