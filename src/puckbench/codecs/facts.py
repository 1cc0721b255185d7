"""Properties of codecs that do not depend on their input, for planning, tables and figures."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple

from pointkit.errors import InputError, among, naming
from pointkit.geometry.cloud import CoordinateFrame
from pointkit.models import Model, parsed

Parameters = Mapping[str, Any]
Line = Literal["-", "--", "-.", ":"]
Takes = Literal["points", "returns", "either"]
LENGTHS_MM = (100, 50, 20, 10, 5, 2, 1)
"""Default rates for clouds in metres: quantisation steps in mm, the smallest bitrate first."""


def lengths(*millimetres: int) -> dict[str, Parameters]:
    """Return rates for clouds in metres, whose only parameter is the quantisation step.

    Parameters
    ----------
    *millimetres
        Steps in mm, the smallest bitrate first; by default `LENGTHS_MM`.

    Returns
    -------
    dict
        Parameters by rate name, such as ``{"10mm": {"step_m": 0.01}}``.
    """
    return {f"{length}mm": {"step_m": length / 1000} for length in millimetres or LENGTHS_MM}


_LENGTH = re.compile(r"([-+]?\d*\.?\d+)(um|mm|cm|m)")
_MILLIMETRES = {"um": 0.001, "mm": 1, "cm": 10, "m": 1000}
_LEAST_MM, _MOST_MM = 0.001, 100_000


def _millimetres(rate: str) -> float | None:
    if (match := _LENGTH.fullmatch(rate)) is None:
        return None
    length = float(f"{float(match[1]) * _MILLIMETRES[match[2]]:.6g}")
    if not _LEAST_MM <= length <= _MOST_MM:
        raise InputError(f"rate '{rate}': a length must be from {_LEAST_MM:g}mm to 100m")
    return length


def check_lengths(rates: Iterable[str]) -> None:
    """Raise InputError if the name of a rate is a length below 0.001 mm or above 100 m."""
    for rate in rates:
        _millimetres(rate)


def find_rate(codec: CodecFacts | type[CodecFacts], rate: str) -> tuple[str, Parameters] | None:
    """Look up a rate of a codec by name.

    If the codec allows `any_length` and its `metric_rates` have no parameter but ``step_m``, the
    name may be any length. It is the quantisation step.

    Parameters
    ----------
    codec
        The codec, or its class.
    rate
        Name of a rate, such as "r1" or "2cm".

    Returns
    -------
    tuple or None
        The name of the rate, with lengths in mm ("20mm" for "2cm"), and its parameters. None means
        that the codec lacks the rate.

    Raises
    ------
    InputError
        The name is a length below 0.001 mm or above 100 m.
    """
    offered = {**codec.rates, **codec.metric_rates}
    if rate in offered:
        return rate, offered[rate]
    if (length := _millimetres(rate)) is None:
        return None
    name, steps = f"{length:g}mm", codec.metric_rates.values()
    if name in codec.metric_rates:
        return name, codec.metric_rates[name]
    has_any = codec.any_length and steps and all({*step} == {"step_m"} for step in steps)
    return (name, {"step_m": length / 1000}) if has_any else None


class Memory(NamedTuple):
    """An estimate of the memory that encoding or decoding takes.

    Parameters
    ----------
    base_mb
        Constant part in MB.
    bytes_per_point
        Further bytes for each point.
    """

    base_mb: float = 400.0
    bytes_per_point: float = 1000.0

    def of(self, points: int) -> int:
        """Return the estimated memory in MB for a number of points."""
        return int(self.base_mb) + int(points * self.bytes_per_point) // 1_000_000


class Pace(NamedTuple):
    """An estimate of the time that encoding and decoding a cloud take together.

    Parameters
    ----------
    base_s
        Constant part in s.
    per_million_s
        Further seconds for a million points.
    encoding
        Fraction of the time that encoding takes.
    """

    base_s: float = 0.1
    per_million_s: float = 10.0
    encoding: float = 0.5

    def of(self, points: int) -> float:
        """Return the estimated time in s for a number of points."""
        return self.base_s + self.per_million_s * points / 1_000_000


class _RateParameters(dict[str, Any]):
    def __init__(self, parameters: Parameters, name: str) -> None:
        super().__init__(parameters)
        self._name = name

    def __missing__(self, key: str) -> Any:
        raise InputError(f"{self._name} lacks the parameter {key!r}")


class CodecFacts:
    """Properties of a codec that do not depend on its input.

    Parameters
    ----------
    name
        Name in a run and in tables.
    rates, metric_rates
        Parameters by rate name, the smallest bitrate first; by default those of the class.
    options
        Values of the class's `Options`.

    Raises
    ------
    InputError
        An option is unknown, or has a value that is not allowed.
    """

    title: str = ""
    """Title in legends; by default, the name of the codec is used."""
    use: str = ""
    """A few words on what the codec is good for."""
    colour: str = ""
    """Colour of the codec's curves as ``#rrggbb``; by default, it is derived from the name."""
    marker: str = ""
    """Matplotlib marker on the codec's curves; by default, it is derived from the name."""
    line: Line = "-"
    rank: int = 1000
    """Position in legends and lists; codecs of equal rank are ordered by name."""

    rates: Mapping[str, Parameters] = MappingProxyType({})
    """Rates for scaled clouds: their parameters by name, the smallest bitrate (r1) first."""
    metric_rates: Mapping[str, Parameters] = MappingProxyType({})
    """Rates for clouds in metres: their parameters by name, which is usually a length."""
    any_length: ClassVar[bool] = True
    """Whether every length is a rate, provided that the step is the only parameter of
    `metric_rates`."""
    takes: ClassVar[Takes] = "points"
    """What is encoded: points, the returns of a spinning sensor, or either. With "either",
    points are encoded if the cloud has no returns."""
    packets_alone: ClassVar[bool] = False
    """Whether the codec encodes only returns of recorded data packets, and refuses virtual
    scans."""
    Options: type[Model] = Model
    """Pydantic model of the codec's options; by default, there are none."""
    options: Any
    surfaces: bool = False
    """Whether `decode_mesh` returns surfaces with labelled primitives."""
    memory: Memory = Memory()
    pace: Pace = Pace()
    training: str = ""
    """Class of the training settings (``module:Class``) if the codec has trained weights, else
    empty."""
    based_on: str = ""
    """Name of the published codec that this codec modifies. If a run lacks the published codec,
    statements about the published codec may be tested on this one."""
    grid: float = 0.0
    """Grid step of the finest rate, in units of the input; 0 if the grid adapts to the cloud's
    extent."""
    most_steps: float = math.inf
    """Maximum extent along an axis, in grid steps of the rate, for clouds in metres."""

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
        """The version of the implementation. A subclass may define an attribute instead."""
        return ""

    @property
    def attributes(self) -> tuple[str, ...]:
        """The names of the attributes that the codec encodes (`puckbench.geometry.attributes`)."""
        return ()

    @property
    def needs_scaled(self) -> bool:
        """Whether `rates` are for scaled clouds only.

        This is so if the codec has a fixed grid, and the option `unit` is not set.
        """
        return self.grid > 0 and getattr(self.options, "unit", None) is None

    def weights_of(self, rate: str) -> str:
        """Return the name of the trained weights that a rate uses, or "" if the codec has none."""
        return ""

    def weights_files(self) -> list[Path]:
        """Return the paths of the weights files; raise InputError if they are missing."""
        return []

    def rates_of(self, frame: CoordinateFrame | None) -> Mapping[str, Parameters]:
        """Return the rates for clouds in a coordinate frame: their parameters by name.

        The result may be empty. If the option `unit` is set, `rates` are used for clouds in metres
        too.
        """
        has_unit = getattr(self.options, "unit", None) is not None
        return self.metric_rates if frame == "metric" and not has_unit else self.rates

    def most_extent(self, rate: str) -> float:
        """Return the largest extent along an axis, in m, that a cloud may have at a rate.

        A run skips the rate for wider clouds. For rates of scaled clouds, the extent is infinite.
        """
        return self.most_steps * float(self.parameters_of(rate).get("step_m", math.inf))

    def check_frame(self, frame: CoordinateFrame | None, rate: str | None = None) -> None:
        """Raise InputError if the codec cannot encode clouds in a coordinate frame.

        Parameters
        ----------
        frame
            Coordinate frame of the cloud; None if unknown.
        rate
            Name of the requested rate; by default, all rates for the frame are checked.
        """
        offered = self.rates_of(frame) or self.rates or self.metric_rates
        requested = offered if rate is None else (rate,)
        if any(map(self.is_length, requested)):
            self._check_metric(frame)
        elif self.needs_scaled and frame != "scaled":
            self._refuse_unscaled(frame)

    def _check_metric(self, frame: CoordinateFrame | None) -> None:
        if frame == "metric":
            return
        fault = "is scaled" if frame else "does not say that it is in metres (--frame metric)"
        remedy = f": use one of {', '.join(self.rates)}" if self.rates else ""
        raise InputError(
            f"codec {self.name}: rates such as {next(iter(self.metric_rates))} are lengths, "
            f"and the cloud {fault}{remedy}"
        )

    def _refuse_unscaled(self, frame: CoordinateFrame | None) -> None:
        fault = "is in metres" if frame else "does not say whether it is scaled"
        remedy = "" if frame else ", or say that it is (--frame scaled, or about={'size': 1024})"
        if frame and self.metric_rates:
            remedy = f", or use a rate of {', '.join(self.metric_rates)}"
        elif hasattr(self.options, "unit"):
            remedy += ", or give the codec a unit in metres (--entry)"
        raise InputError(
            f"codec {self.name}: its rates are steps of a scaled cloud's grid, and the cloud "
            f"{fault}: prepare it (puckbench prepare, encode --prepare, or in Python "
            f"puckbench.prepare){remedy}"
        )

    def is_length(self, rate: str) -> bool:
        """Return whether a rate is only for clouds in metres."""
        return rate not in self.rates and find_rate(self, rate) is not None

    def rate_name(self, rate: str) -> str:
        """Return the name of a rate in results; raise InputError if the rate is unknown."""
        return self._find(rate)[0]

    def parameters_of(self, rate: str) -> Parameters:
        """Return the parameters of a rate by name.

        Raises InputError if the rate is unknown. Reading a parameter that the rate lacks raises
        InputError too.
        """
        return _RateParameters(self._find(rate)[1], f"codec {self.name}: rate {rate}")

    def _find(self, rate: str) -> tuple[str, Parameters]:
        with naming(f"codec {self.name}"):
            if not isinstance(rate, str):
                raise InputError(f"a rate is a name, not {type(rate).__name__}")
            if (item := find_rate(self, rate)) is None:
                offered = {**self.rates, **self.metric_rates}
                raise InputError(f"unknown rate '{rate}'{among(rate, offered)}")
        return item
