"""The contract of codecs: a class with rates and the methods `encode` and `decode`.

A user's codec is one file::

    import numpy as np

    from puckbench.codecs.base import Codec, PointCloud

    class Raw(Codec):
        rates = {"r1": {"kind": "<f2"}, "r2": {"kind": "<f4"}}

        def encode(self, cloud, rate):
            kind = self.rates[rate]["kind"]
            return kind.encode() + cloud.xyz.astype(kind).tobytes()

        def decode(self, stream):
            numbers = np.frombuffer(stream[3:], stream[:3].decode())
            return PointCloud(numbers.reshape(-1, 3).astype(float))

`puckbench.codecs.coding` calls codecs: it checks clouds and streams, and shifts far clouds.
`puckbench.codecs.rates` has functions of rates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, Self

from pointkit.errors import NARROWER, InputError
from pointkit.geometry.cloud import CoordinateFrame, PointCloud
from pointkit.geometry.mesh import Mesh
from pointkit.measurement import NO_COST, Cost
from pointkit.models import Model, parsed
from puckbench.codecs.rates import (  # noqa: F401 (for codecs of users)
    Parameters,
    frame_fault,
    lengths,
    parameters_of,
)

CODE = (
    "puckbench.codecs.coding",
    "puckbench.codecs.old_contract",
    "puckbench.codecs.rates",
    "puckbench.codecs.shift",
    "puckbench.codecs.unit",
    "puckbench.codecs.weights_label",
    "puckbench.geometry.attributes",
)

__all__ = ["CloudKind", "Codec", "SharedWork"]


class CloudKind(NamedTuple):
    """What is known of a cloud before it is encoded, or even before it exists.

    Parameters
    ----------
    frame
        Coordinate frame of the cloud; None if unknown.
    has_returns
        Whether the cloud has the returns of a spinning sensor.
    has_packets
        Whether these returns may come from recorded data packets, and not from a virtual scan.
    extent_m
        Longest side of the bounding box, m, of a cloud in metres; None if it was not measured.
    """

    frame: CoordinateFrame | None
    has_returns: bool = False
    has_packets: bool = False
    extent_m: float | None = None

    @classmethod
    def of(cls, cloud: PointCloud) -> Self:
        """Return what is known of an existing cloud.

        The extent is left out: encoders measure it themselves, and refuse wide clouds.
        """
        has_returns = cloud.returns is not None
        return cls(cloud.frame, has_returns, has_returns)

    def wider_than(self, most_m: float) -> str | None:
        """Return a message if the cloud's extent is known, and exceeds `most_m` metres."""
        if self.extent_m is None or self.extent_m <= most_m:
            return None
        return f"the cloud is {self.extent_m:,.0f} m wide, more than {most_m:,.0f} m{NARROWER}"


class SharedWork(Protocol):
    """Results of a cloud that all rates share.

    The first encoding of the cloud stores the results. Encodings at other rates reuse them.
    """

    saved: Cost = NO_COST
    """Cost of computing the results that the last encoding reused."""


class Codec(ABC):
    """Base class of codecs, which encode a point cloud to a byte string and decode it.

    A subclass must define `rates`, `encode` and `decode`; other members have defaults. The byte
    string (stream) contains all that the decoder needs. Results must depend only on the arguments
    of a call. When a run is planned, the subclass's module is imported, so slow packages should be
    imported inside methods.

    Parameters
    ----------
    name
        Name in a run and in tables.
    rates
        Parameters by rate name, the smallest bitrate first; by default those of the class.
    options
        Values of the class's `Options`.

    Raises
    ------
    InputError
        An option is unknown, or has a value that is not allowed.
    """

    rates: Mapping[str, Parameters] = MappingProxyType({})
    """Parameters by name of the rate, the smallest bitrate (r1) first. Rates that are lengths, such
    as ``10mm``, are for clouds in metres. If ``step_m`` is their only parameter, every length is a
    rate."""
    Options: type[Model] = Model
    """Pydantic model of the codec's options; by default, there are none."""
    options: Any
    along_rays: bool = False
    """Whether points move along their rays, and not to a grid, if returns are coded with loss."""
    magic: bytes = b""
    """First bytes of the codec's streams, by which `codec_of` recognises them."""

    def __init__(
        self, name: str, rates: Mapping[str, Parameters] | None = None, **options: Any
    ) -> None:
        self.name = name
        self.rates = dict(self.rates if rates is None else rates)
        self.options = parsed(self.Options, options, f"codec {name}")

    @property
    def version(self) -> str:
        """The version of the implementation. A subclass may define an attribute instead."""
        return ""

    @property
    def attributes(self) -> tuple[str, ...]:
        """What the codec encodes besides points.

        It names attributes (`puckbench.geometry.attributes`), and ``returns`` if the codec encodes
        the returns of a spinning sensor. A subclass may define an attribute instead.
        """
        return ()

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        """Return why the codec does not encode a cloud at a rate, in one line, or None if it does.

        A run leaves out what codecs skip, and tells the reason: another coordinate frame, too wide
        a cloud, no returns, a program or package that is not installed. By default, rates that are
        lengths need clouds in metres.

        Parameters
        ----------
        cloud
            What is known of the cloud.
        rate
            Name of the rate.
        """
        return frame_fault(self, cloud.frame, rate)

    def weights(self, rate: str) -> Path | None:
        """Return the file of trained weights that a rate uses, or None if it uses none.

        Raises InputError if the file is missing.
        """
        return None

    def load(self) -> None:  # noqa: B027 (many codecs need none)
        """Prepare the codec before timed calls: load weights and compile functions."""

    def prepare(self, cloud: PointCloud) -> SharedWork | None:
        """Return a new, empty object for results of a cloud that all rates share, or None.

        None means that the codec has no such results. The caller passes the object to `encode` for
        each rate of the cloud.
        """
        return None

    @abstractmethod
    def encode(self, cloud: PointCloud, rate: str, work: Any = None) -> bytes:
        """Encode a cloud at a rate to a self-contained byte string, which is not empty.

        Parameters
        ----------
        cloud
            At least one point, with what the cloud has: returns, colours, fields. The codec takes
            what it can, and names this in `attributes`.
        rate
            Name of a rate of `rates`, or any length if the codec allows it (`parameters_of`).
        work
            Object from `prepare` for this cloud, or None. A codec without `prepare` may omit the
            parameter.

        Raises
        ------
        InputError
            The codec cannot encode the cloud.
        """

    @abstractmethod
    def decode(self, stream: bytes) -> PointCloud:
        """Decode a byte string to a cloud, with the returns and attributes that it contains.

        The order of the points is arbitrary. Raises InputError if the byte string is damaged or
        belongs to another codec.
        """

    def surfaces(self, stream: bytes) -> Mesh:
        """Decode a byte string to a triangulated surface in the coordinates of the encoded cloud.

        A codec that defines this method returns triangles that are labelled with primitives and
        objects (`pointkit.geometry.mesh`). Raises InputError if the byte string has no surface.
        """
        raise InputError("codes points, not surfaces")

    def attribute_bytes(self, stream: bytes) -> Mapping[str, int]:
        """Return how many bytes of a stream each attribute takes, by name of the attribute."""
        return {}


def __getattr__(name: str) -> Any:
    """Return what codecs of the old contract import from here."""
    from puckbench.codecs import old_contract

    if name in old_contract.NAMES:
        return getattr(old_contract, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
