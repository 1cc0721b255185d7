"""What plans, tables and figures need to know of a codec: name, style, rates, memory, pace."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple

from puckbench.core.errors import InputError
from puckbench.core.models import Model, among, parsed
from puckbench.geometry.cloud import CoordinateFrame

Parameters = Mapping[str, Any]
Line = Literal["-", "--", "-.", ":"]
Takes = Literal["points", "returns", "either"]
LENGTHS_MM = (100, 50, 20, 10, 5, 2, 1)
"""Usual rates of clouds in metres, the smallest bitrate first."""


def lengths(*millimetres: int) -> dict[str, Parameters]:
    """Rates of clouds in metres by their names (10mm): the parameter ``step_m``."""
    return {f"{length}mm": {"step_m": length / 1000} for length in millimetres or LENGTHS_MM}


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


class CodecFacts:
    """What is known of a codec before it codes anything.

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
    most_steps: ClassVar[float] = math.inf
    """Steps of a rate that is a length, at most, that a cloud may extend along an axis."""

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
    def needs_scaled(self) -> bool:
        """Whether rates are steps of a scaled cloud's grid: not where an option `unit` is given."""
        return self.grid > 0 and getattr(self.options, "unit", None) is None

    def weights_of(self, rate: str) -> str:
        """Which trained weights code at a rate, for the results table; most codecs have none."""
        return ""

    def weights_files(self) -> list[Path]:
        """The files of its weights, whose content a stream depends on; InputError if missing."""
        return []

    def rates_of(self, frame: CoordinateFrame | None) -> Mapping[str, Parameters]:
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

    def check_frame(self, frame: CoordinateFrame | None, rate: str | None = None) -> None:
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
