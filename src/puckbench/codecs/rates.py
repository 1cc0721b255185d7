"""Rates of codecs: tables of parameters by name, the smallest bitrate first.

A rate named by a length, such as ``10mm``, or with the parameter ``step_m`` is for clouds in
metres. All other rates are for scaled clouds. Budgets of bits, such as ``1.5bpp``, are for both.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

from pointkit.errors import InputError, among, naming
from pointkit.geometry.cloud import CoordinateFrame, PointCloud

if TYPE_CHECKING:
    from puckbench.codecs.base import Codec

Parameters = Mapping[str, Any]
LENGTHS_MM = (100, 50, 20, 10, 5, 2, 1)
"""Default rates for clouds in metres: quantisation steps in mm, the smallest bitrate first."""
_LENGTH = re.compile(r"([-+]?\d*\.?\d+)(um|mm|cm|m)")
_MILLIMETRES = {"um": 0.001, "mm": 1, "cm": 10, "m": 1000}
_LEAST_MM, _MOST_MM = 0.001, 100_000
BudgetUnit = Literal["bpp", "mbps"]
_BUDGET = re.compile(rf"(\d+\.?\d*|\.\d+)({'|'.join(get_args(BudgetUnit))})")
_BUDGETS = "_run_at_budgets"
"""Name of the attribute with a codec's budgets, which is no part of the contract of codecs."""
_WORDS: Mapping[str, str] = {"bpp": "bits per point", "mbps": "Mbit/s"}


class StepRange(NamedTuple):
    """The quantisation steps, m, that a codec may use for a cloud.

    A codec's method `step_range(cloud)` returns them to a search for the step that meets a budget
    of bits. Without the method, they are `ANY_STEP`.

    Parameters
    ----------
    finest_m, coarsest_m
        Smallest and largest step, m.
    unit_m
        Length of which steps are multiples, m; None for any step.
    """

    finest_m: float
    coarsest_m: float
    unit_m: float | None = None


ANY_STEP = StepRange(_LEAST_MM / 1000, _MOST_MM / 1000)
"""The steps that names of rates can state."""


def step_range(codec: Codec, cloud: PointCloud) -> StepRange:
    """Return which quantisation steps the rates of a codec that are lengths may have for a cloud.

    They are all that names of rates can state, unless the codec has a method `step_range`.
    """
    own = getattr(codec, "step_range", None)
    steps: StepRange = ANY_STEP if own is None else own(cloud)
    return steps


def takes_any_scale(codec: Codec) -> bool:
    """Return whether the parameter `scale` of a codec's rates for scaled clouds may be any number.

    The codec multiplies coordinates by it before they are rounded, and says so by its attribute
    `any_scale`.
    """
    return bool(getattr(codec, "any_scale", False))


class Budget(NamedTuple):
    """The most bits that streams may take.

    Parameters
    ----------
    amount
        Number of bits per point, or megabits per second of the time that the sensor recorded.
    unit
        ``bpp`` for bits per point, ``mbps`` for megabits per second.
    """

    amount: float
    unit: BudgetUnit

    @property
    def name(self) -> str:
        """The name of the rate, such as ``1.5bpp``."""
        return f"{self.amount:g}{self.unit}"

    @property
    def words(self) -> str:
        """The unit in words."""
        return _WORDS[self.unit]

    @property
    def parameters(self) -> Parameters:
        """The parameters of the rate: the amount by unit."""
        return {self.unit: self.amount}

    def bits(self, points: int, seconds: float | None = None) -> float:
        """Return the most bits of the streams of a number of points.

        `seconds` is the time in which the sensor recorded them. Raises InputError if it is needed,
        and None.
        """
        if self.unit == "bpp":
            return self.amount * points
        if not seconds:
            raise InputError(f"{self.name}: the time in which the points were recorded is unknown")
        return self.amount * 1e6 * seconds


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


def metric_rates(table: Mapping[str, Parameters]) -> dict[str, Parameters]:
    """Return those rates of a table that are for clouds in metres."""
    return {
        name: parameters
        for name, parameters in table.items()
        if "step_m" in parameters or _LENGTH.fullmatch(name)
    }


def scaled_rates(table: Mapping[str, Parameters]) -> dict[str, Parameters]:
    """Return those rates of a table that are for scaled clouds."""
    metric = metric_rates(table)
    return {name: parameters for name, parameters in table.items() if name not in metric}


def check_metric(table: Mapping[str, Parameters]) -> None:
    """Raise InputError if a rate of a table is not one for clouds in metres."""
    for name in scaled_rates(table):
        raise InputError(f"metric_rates: {name!r} is no length, and has no parameter 'step_m'")


def find_rate(codec: Codec | type[Codec], rate: str) -> tuple[str, Parameters] | None:
    """Look up a rate of a codec by name.

    If ``step_m`` is the only parameter of all its rates for clouds in metres, the name may be any
    length. It is the quantisation step.

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
    if rate in codec.rates:
        return rate, codec.rates[rate]
    if (length := _millimetres(rate)) is None:
        return None
    name = f"{length:g}mm"
    if name in codec.rates:
        return name, codec.rates[name]
    steps = metric_rates(codec.rates).values()
    has_any = steps and all({*step} == {"step_m"} for step in steps)
    return (name, {"step_m": length / 1000}) if has_any else None


def budget_of(codec: Codec | type[Codec], rate: str) -> Budget | None:
    """Return the budget that the name of a rate states, such as ``1.5bpp`` or ``2mbps``, or None.

    A codec's own rates are none, whatever their names. Raises InputError if the budget is 0.
    """
    match = _BUDGET.fullmatch(rate)
    if match is None or rate in codec.rates:
        return None
    amount = float(match[1])
    if not 0 < amount < math.inf:
        raise InputError(f"rate '{rate}': a budget must be above 0")
    return Budget(amount, "bpp" if match[2] == "bpp" else "mbps")


def budgets_of(codec: Codec) -> tuple[str, ...]:
    """Return the budgets at which a run encodes instead of at the codec's rates, smallest first.

    There are none unless an entry in the configuration names them (`set_budgets`).
    """
    budgets: tuple[str, ...] = vars(codec).get(_BUDGETS, ())
    return budgets


def set_budgets(codec: Codec, budgets: tuple[str, ...]) -> None:
    """Let a codec run at budgets, which it meets by its rates."""
    vars(codec)[_BUDGETS] = budgets


def budgets_among(codec: Codec | type[Codec], rates: Iterable[str]) -> tuple[str, ...]:
    """Return the budgets among names of rates, the smallest first.

    Raises InputError if there are other names beside them, since a codec runs at either.
    """
    names = tuple(rates)
    budgets = {name: each for name in names if (each := budget_of(codec, name))}
    if budgets and (others := [name for name in names if name not in budgets]):
        raise InputError(f"budgets such as {next(iter(budgets))} stand alone, without {others[0]}")
    return tuple(sorted(budgets, key=lambda name: (budgets[name].unit, budgets[name].amount)))


def rates_of(codec: Codec, frame: CoordinateFrame | None) -> dict[str, Parameters]:
    """Return the rates at which a run encodes clouds in a coordinate frame: parameters by name.

    They are the codec's budgets if it has any, and otherwise those of `offered_rates`. The result
    may be empty.
    """
    offered = offered_rates(codec, frame)
    budgets = {name: budget_of(codec, name) for name in budgets_of(codec) if offered}
    return {name: each.parameters for name, each in budgets.items() if each} or offered


def offered_rates(codec: Codec, frame: CoordinateFrame | None) -> dict[str, Parameters]:
    """Return the rates of a codec for clouds in a coordinate frame: their parameters by name.

    The result may be empty. If the codec's option `unit` is set, rates of scaled clouds are used
    for clouds in metres too.
    """
    has_unit = getattr(codec.options, "unit", None) is not None
    is_metric = frame == "metric" and not has_unit
    return metric_rates(codec.rates) if is_metric else scaled_rates(codec.rates)


def is_length(codec: Codec, rate: str) -> bool:
    """Return whether a codec has a rate, and the rate is only for clouds in metres."""
    found = find_rate(codec, rate)
    return found is not None and bool(metric_rates(dict([found])))


def rate_name(codec: Codec, rate: str) -> str:
    """Return the name of a rate in results; raise InputError if the codec lacks the rate."""
    return _found(codec, rate)[0]


def parameters_of(codec: Codec, rate: str) -> Parameters:
    """Return the parameters of a codec's rate by name.

    Raises InputError if the codec lacks the rate. Reading a parameter that the rate lacks raises
    InputError too.
    """
    return _RateParameters(_found(codec, rate)[1], f"codec {codec.name}: rate {rate}")


class _RateParameters(dict[str, Any]):
    def __init__(self, parameters: Parameters, name: str) -> None:
        super().__init__(parameters)
        self._name = name

    def __missing__(self, key: str) -> Any:
        raise InputError(f"{self._name} lacks the parameter {key!r}")


def _found(codec: Codec, rate: str) -> tuple[str, Parameters]:
    with naming(f"codec {codec.name}"):
        if not isinstance(rate, str):
            raise InputError(f"a rate is a name, not {type(rate).__name__}")
        if (found := find_rate(codec, rate)) is None:
            raise InputError(f"unknown rate '{rate}'{among(rate, codec.rates)}")
    return found


def frame_fault(codec: Codec, frame: CoordinateFrame | None, rate: str) -> str | None:
    """Return why a rate cannot be used for clouds in a coordinate frame, or None if it can.

    A rate for clouds in metres cannot be used for other clouds, nor for clouds of unknown frame
    (`frame` is None).
    """
    if frame == "metric" or not is_length(codec, rate):
        return None
    fault = "is scaled" if frame else "does not say that it is in metres (--frame metric)"
    scaled = scaled_rates(codec.rates)
    remedy = f": use one of {', '.join(scaled)}" if scaled else ""
    example = next(iter(metric_rates(codec.rates)), rate)
    return f"rates such as {example} are lengths, and the cloud {fault}{remedy}"


def grid_fault(codec: Codec, frame: CoordinateFrame | None, rate: str) -> str | None:
    """Return why a rate whose unit is a step of a scaled cloud's grid cannot be used, or None.

    Such a rate needs scaled clouds, unless the codec's option `unit` is set. Arguments are those of
    `frame_fault`.
    """
    has_unit = getattr(codec.options, "unit", None) is not None
    if frame == "scaled" or has_unit or is_length(codec, rate):
        return None
    fault = "is in metres" if frame else "does not say whether it is scaled"
    remedy = "" if frame else ", or say that it is (--frame scaled, or about={'size': 1024})"
    metric = metric_rates(codec.rates)
    if frame and metric:
        remedy = f", or use a rate of {', '.join(metric)}"
    elif hasattr(codec.options, "unit"):
        remedy += ", or give the codec a unit in metres (--entry)"
    return (
        f"its rates are steps of a scaled cloud's grid, and the cloud {fault}: prepare it "
        "(puckbench prepare, encode --prepare, or in Python puckbench.prepare)" + remedy
    )
