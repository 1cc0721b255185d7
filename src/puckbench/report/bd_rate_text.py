"""A BD-rate in words, alike in the report, on the terminal and in comparisons.

It stands beside its interval, or the number of clouds that have none; where curves cannot be
compared the reason stands in its place.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan, nan
from typing import Any

from puckbench.metrics.bjontegaard import LITTLE_OVERLAP, NO_COMMON_RANGE
from puckbench.metrics.tables.rate_deltas import MIN_CLOUDS

FEW_CLOUDS = 10
"""Clouds below which a BD-rate stands with their number."""
_REASONS = {
    "no_common_range": NO_COMMON_RANGE,
    "little_overlap": LITTLE_OVERLAP,
    "too_few_points": "fewer than two lossy rates",
}
_Row = Mapping[Any, Any]


def delta_text(row: _Row | None) -> str:
    """A row of the table ``bd_rate`` in one cell: "−50.0 % (−60.0 % to −40.0 %, 3 clouds)"."""
    value, note = delta_value(row), delta_note(row)
    return f"{value} ({note})" if value and note else value or note


def delta_value(row: _Row | None) -> str:
    """The BD-rate alone; empty where there is none."""
    return percent_text(_number(row, "bd_rate_percent")) if has_delta(row) else ""


def has_delta(row: _Row | None) -> bool:
    """Whether a row of the table ``bd_rate`` has a value that is worth its print."""
    return row is not None and not _why_not(row)


def delta_note(row: _Row | None) -> str:
    """What stands beside a BD-rate: its interval and clouds; or why there is none."""
    if row is None:
        return NO_COMMON_RANGE
    return _why_not(row) or ", ".join(filter(None, (_interval(row), _clouds(row))))


def holds_zero(row: _Row) -> bool:
    """Whether the interval of a BD-rate, or the range of two clouds, holds 0 or is missing."""
    low, high = _ends(row)
    return not (low > 0 or high < 0)


def _why_not(row: _Row) -> str:
    compared = _count(row, "compared")
    if not compared:
        counts = {name: _number(row, name) for name in _REASONS}
        known = {name: count for name, count in counts.items() if count > 0}
        return _REASONS[max(known, key=lambda name: known[name])] if known else NO_COMMON_RANGE
    lacks_interval = isnan(_number(row, "bd_rate_percent_low"))
    return "no interval" if MIN_CLOUDS <= compared < FEW_CLOUDS and lacks_interval else ""


def _interval(row: _Row) -> str:
    if _count(row, "compared") == 1:
        return ""
    low, high = _ends(row)
    return "" if isnan(low) else f"{percent_text(low)} to {percent_text(high)}"


def _ends(row: _Row) -> tuple[float, float]:
    """The interval; of fewer clouds than it needs the least and the greatest value."""
    ends = ("low", "high") if _count(row, "compared") >= MIN_CLOUDS else ("least", "most")
    return _number(row, f"bd_rate_percent_{ends[0]}"), _number(row, f"bd_rate_percent_{ends[1]}")


def _clouds(row: _Row) -> str:
    compared, clouds = _count(row, "compared"), _count(row, "clouds")
    if compared < clouds:
        return f"{compared} of {clouds} clouds"
    if compared == 1:
        return "one cloud"
    return f"{compared} clouds" if compared < FEW_CLOUDS else ""


def _count(row: _Row, name: str) -> int:
    return int(float(row[name]))


def _number(row: _Row | None, name: str) -> float:
    """A value of a row, nan where it has none; a row of a CSV file has text."""
    value = None if row is None else row.get(name)
    return nan if value in (None, "") else float(value)


def percent_text(value: float) -> str:
    """A change in percent, with its sign: −53.6 %, +118 %."""
    text = f"{abs(value):.0f}" if abs(value) >= 100 else f"{abs(value):.1f}"
    sign = "\N{MINUS SIGN}" if value < 0 else "+"
    return f"{sign}{text}\N{NO-BREAK SPACE}%"
