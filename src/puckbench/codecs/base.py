"""What a codec is: a class with rates, `_encode` and `_decode`, registered under a name.

A codec of one's own is one file::

    from puckbench.codecs.base import Codec
    from puckbench.codecs.registry import CODECS

    @CODECS.register("raw")
    class Raw(Codec):
        title = "Raw floats"
        rates = {"r1": {"kind": "<f2"}, "r2": {"kind": "<f4"}}

        def _encode(self, points, parameters):
            return parameters["kind"].encode() + points.astype(parameters["kind"]).tobytes()

        def _decode(self, stream):
            return np.frombuffer(stream[3:], stream[:3].decode()).reshape(-1, 3).astype(float)
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np

from puckbench.codecs.common.shift import moved, shift_of, shifted, unshifted
from puckbench.core.errors import InputError, naming
from puckbench.core.models import Model, among, parsed
from puckbench.geometry.cloud import Floats, Frame, PointCloud, check_points
from puckbench.geometry.mesh import Mesh, surface_in_metres

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns

Parameters = Mapping[str, Any]
Line = Literal["-", "--", "-.", ":"]
Takes = Literal["points", "returns", "either"]
LENGTHS_MM = (100, 50, 20, 10, 5, 2, 1)
"""Usual rates of clouds in metres, the smallest bitrate first."""


def lengths(*millimetres: int) -> dict[str, Parameters]:
    """Rates of clouds in metres by their names (10mm): the parameter ``step_m``."""
    return {f"{length}mm": {"step_m": length / 1000} for length in millimetres or LENGTHS_MM}


class Availability(NamedTuple):
    """Whether a codec can run here and, if not, why (one line)."""

    ok: bool
    why: str = ""


class Cost(NamedTuple):
    """What a call cost: seconds, and peak memory in MiB."""

    seconds: float
    peak_mib: float


class Memory(NamedTuple):
    """Estimate of the memory of coding a cloud: MB, and bytes for each point of it."""

    base_mb: float = 400.0
    bytes_per_point: float = 1000.0

    def of(self, points: int) -> int:
        """The estimate in MB for a number of points."""
        return int(self.base_mb) + int(points * self.bytes_per_point) // 1_000_000


class Pace(NamedTuple):
    """Estimate of the time of coding and decoding at one rate: s, and s for a million points.

    encoding: the share of encoding in it.
    """

    base_s: float = 0.1
    per_million_s: float = 10.0
    encoding: float = 0.5

    def of(self, points: int) -> float:
        """The estimate in s for a number of points."""
        return self.base_s + self.per_million_s * points / 1_000_000


class Codec(ABC):
    """A codec of point-cloud geometry: points to a self-contained byte string, and back.

    A subclass names its `rates` and implements `_encode` and `_decode`; everything else has a
    default. Its module should import heavy packages inside of methods, since planning, figures and
    ``puckbench codecs`` import it.

    Parameters
    ----------
    name
        Under which it runs and appears in tables.
    rates, metric_rates
        Parameters by the rate's name, the smallest bitrate first; the class's own by default.
    options
        Of the class's `Options`.

    Raises
    ------
    InputError
        An option is unknown, or cannot have its value.
    """

    title: str = ""
    """In legends; its name by default."""
    use: str = ""
    """What to take it for, in a few words."""
    colour: str = ""
    """Of its curves, ``#rrggbb``; by default one that follows from its name."""
    marker: str = ""
    """Matplotlib's sign for its points; by default one that follows from its name."""
    line: Line = "-"
    rank: int = 1000
    """Its place in legends and lists; those of equal rank stand by name."""

    rates: Mapping[str, Parameters] = MappingProxyType({})
    """Of scaled clouds: parameters by the rate's name, the smallest bitrate (r1) first."""
    metric_rates: Mapping[str, Parameters] = MappingProxyType({})
    """Of clouds in metres: parameters by the rate's name, a length, the smallest bitrate first."""
    takes: ClassVar[Takes] = "points"
    """What is coded of a cloud: its points, the returns of the sensor that measured it, or either:
    returns of a cloud that has some, else points."""
    packets_alone: ClassVar[bool] = False
    """Whether it codes returns of data packets alone, not those of virtual scans."""
    Options: type[Model] = Model
    """The model of its options; by default it has none."""
    options: Any
    magic: bytes = b""
    """What its streams begin with, by which they are recognised."""
    bare_magic: bytes = b""
    """First bytes of the reference program's streams, too few to recognise them by."""
    surfaces: bool = False
    """Whether `decode_mesh` gives surfaces with labelled primitives."""
    memory: Memory = Memory()
    pace: Pace = Pace()
    training: str = ""
    """``module:Class`` of the settings of its training, for a codec with weights of its own."""
    based_on: str = ""
    """Name of the codec that it changes, for which it does not stand in any claim."""
    grid: float = 0.0
    """Spacing of the grid that coordinates are rounded to at the finest rate, in units of the
    input; 0 for a codec that adapts to the extent of the cloud."""
    shifts_far_clouds: bool = True
    """Whether clouds far from the origin are shifted to it before coding (`common.shift`)."""
    most_steps: ClassVar[float] = math.inf
    """Steps of a rate that is a length, at most, that a cloud may extend along an axis."""
    is_single_precision: ClassVar[bool] = False
    """Whether coordinates are coded from single precision, which wants a shift at fine steps."""

    def __init__(
        self,
        name: str,
        rates: Mapping[str, Parameters] | None = None,
        metric_rates: Mapping[str, Parameters] | None = None,
        **options: Any,
    ) -> None:
        self.name = name
        self.rates = dict(self.rates if rates is None else rates)
        self.metric_rates = dict(self.metric_rates if metric_rates is None else metric_rates)
        self.options = parsed(self.Options, options, f"codec {name}")

    @property
    def version(self) -> str:
        """Version of the implementation, for the results table; a class may just assign it."""
        return ""

    @property
    def has_surfaces(self) -> bool:
        """Whether a stream can be decoded to a surface: the class implements `_decode_mesh`."""
        return type(self)._decode_mesh is not Codec._decode_mesh

    @property
    def needs_scaled(self) -> bool:
        """Whether rates are steps of a scaled cloud's grid: not where an option `unit` is given."""
        return self.grid > 0 and getattr(self.options, "unit", None) is None

    @property
    def thesis_role(self) -> str:
        """Which of the thesis's codecs it is (see `puckbench.thesis.claims.roles`), if any."""
        return ""

    def weights_of(self, rate: str) -> str:
        """Which trained weights code at a rate, for the results table; most codecs have none."""
        return ""

    def weights_files(self) -> list[Path]:
        """The files of its weights, whose content a stream depends on; InputError if missing."""
        return []

    def available(self) -> Availability:
        """Whether the codec can run on this machine."""
        return Availability(True)

    def load(self) -> None:  # noqa: B027 (most codecs have nothing to load)
        """Do once, outside the timed calls, what a first call would pay for (weights, JIT)."""

    def cost(self, here: Cost) -> Cost:
        """What the last call cost.

        Parameters
        ----------
        here
            What it cost in this process: all, unless the codec runs outside of it, or had done a
            part of the work before.
        """
        return here

    def rates_of(self, frame: Frame | None) -> Mapping[str, Parameters]:
        """The rates for clouds of a frame: lengths for those in metres; empty where it has none.

        With an option `unit` all rates are for clouds in metres.
        """
        has_unit = getattr(self.options, "unit", None) is not None
        return self.metric_rates if frame == "metric" and not has_unit else self.rates

    def most_extent(self, rate: str) -> float:
        """Extent of a cloud along an axis, m, at most, where a rate is a length; else infinite.

        Of wider clouds a run leaves this rate out.
        """
        return self.most_steps * float(self.parameters_of(rate).get("step_m", math.inf))

    def check_frame(self, frame: Frame | None, rate: str | None = None) -> None:
        """Refuse a cloud whose frame is not that of the rates.

        Parameters
        ----------
        frame
            Of the cloud; None if it is not known.
        rate
            The one that is wanted; all of the frame's if not given.

        Raises
        ------
        InputError
            Rates are steps of a scaled cloud's grid, and this is none; or they are lengths, and
            this is not in metres.
        """
        usual = self.rates_of(frame) or self.rates or self.metric_rates
        wanted = usual if rate is None else (rate,)
        if any(name in self.metric_rates for name in wanted):
            if frame == "metric":
                return
            is_what = "is scaled" if frame else "does not say that it is in metres (--frame metric)"
            instead = f": take one of {', '.join(self.rates)}" if self.rates else ""
            raise InputError(
                f"codec {self.name}: rates such as {next(iter(self.metric_rates))} are lengths, "
                f"and the cloud {is_what}{instead}"
            )
        if not self.needs_scaled or frame == "scaled":
            return
        is_what = "is in metres" if frame else "does not say whether it is scaled"
        has_unit = hasattr(self.options, "unit")
        metric = "" if frame else ", or say that it is (--frame scaled)"
        metric += ", or give the codec a unit in metres (--entry)" if has_unit else ""
        if frame and self.metric_rates:
            metric = f", or take a rate of {', '.join(self.metric_rates)}"
        raise InputError(
            f"codec {self.name}: its rates are steps of a scaled cloud's grid, and the cloud "
            f"{is_what}: prepare it (puckbench prepare, or encode --prepare){metric}"
        )

    def parameters_of(self, rate: str) -> Parameters:
        """The parameters of a rate; InputError when there is none of the name."""
        known = {**self.rates, **self.metric_rates}
        if rate not in known:
            raise InputError(f"codec {self.name}: unknown rate '{rate}'{among(rate, known)}")
        return known[rate]

    def encode_cloud(self, cloud: PointCloud, rate: str) -> bytes:
        """Code a cloud at a named rate: what the codec takes of it, points or returns.

        Raises
        ------
        InputError
            As for `encode`, and where the codec takes returns and the cloud has none.
        """
        if self.takes == "points" or (self.takes == "either" and cloud.returns is None):
            return self.encode(cloud.xyz, rate)
        if cloud.returns is None:
            raise InputError(
                f"codec {self.name}: codes the returns of a spinning sensor, and the cloud has none"
            )
        return self.encode_returns(cloud.returns, rate)

    def encode_returns(self, returns: Returns, rate: str) -> bytes:
        """Code a spinning sensor's returns at a named rate; InputError as for `encode`."""
        return self.encode(returns.points(), rate)

    def decode_cloud(self, stream: bytes) -> PointCloud:
        """The cloud of a stream: its points and, where the codec codes them, returns."""
        return PointCloud(self.decode(stream))

    def encode(self, points: Floats, rate: str) -> bytes:
        """Code points at a named rate.

        Parameters
        ----------
        points
            (n, 3) coordinates.
        rate
            One of `rates`.

        Returns
        -------
        bytes
            All that the decoder needs.

        Raises
        ------
        InputError
            An unknown rate, an empty cloud, or coordinates that are not finite.
        """
        parameters = self.parameters_of(rate)
        check_points(points, f"codec {self.name}")
        points = np.ascontiguousarray(points, dtype=np.float64)
        step = parameters.get("step_m") if self.is_single_precision else None
        shift = shift_of(points, step) if self.shifts_far_clouds else None
        if shift is None:
            return self._encode(points, parameters)
        return shifted(self._encode(points - shift, parameters), shift)

    def decode(self, stream: bytes) -> Floats:
        """Points (m, 3) in the coordinates of the input cloud, in any order.

        Raises
        ------
        InputError
            The stream is not this codec's, or damaged.
        """
        with naming(f"codec {self.name}"):
            own, shift = unshifted(stream)
        points = self._decode(own)
        return points if shift is None else moved(points, shift)

    def decode_mesh(self, stream: bytes) -> Mesh:
        """Triangles in the coordinates of the input cloud, where a codec codes surfaces.

        The labels say which geometric primitive each triangle lies on (kind and parameters as in
        `puckbench.geometry.mesh`, in those coordinates too) and, as object, which piece of surface
        it belongs to: a wall is one object however many primitives it was coded in.

        Raises
        ------
        InputError
            As for `decode`, for a codec that has no surfaces, and for a stream without one.
        """
        with naming(f"codec {self.name}"):
            own, shift = unshifted(stream)
        mesh = self._decode_mesh(own)
        return mesh if shift is None else surface_in_metres(mesh, 1.0, shift)

    def _decode_mesh(self, stream: bytes) -> Mesh:
        """The surfaces of a stream, where a codec codes surfaces; InputError as for `_decode`."""
        raise InputError(f"codec {self.name}: codes points, not surfaces")

    @abstractmethod
    def _encode(self, points: Floats, parameters: Parameters) -> bytes:
        """Code points (n, 3), n >= 1 and finite, with a rate's parameters."""

    @abstractmethod
    def _decode(self, stream: bytes) -> Floats:
        """Points (m, 3) of a stream; InputError for a damaged or a foreign one."""
