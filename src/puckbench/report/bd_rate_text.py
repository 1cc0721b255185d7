from __future__ import annotations

from collections.abc import Mapping
from math import isnan, nan
from typing import Any

from puckbench.metrics.bjontegaard import LITTLE_OVERLAP, NO_COMMON_RANGE
from puckbench.metrics.scenes import MIN_CLOUDS

FEW_CLOUDS = 10
"""Number of clouds below which a text states how many clouds were compared."""
_REASONS = {
    "no_common_range": NO_COMMON_RANGE,
    "little_overlap": LITTLE_OVERLAP,
    "too_few_points": "fewer than two lossy rates",
}
_Row = Mapping[Any, Any]


def delta_text(row: _Row | None) -> str:
    """Return a row of the table ``bd_rate`` as text: "−50.0 % (−60.0 % to −40.0 %, 3 clouds)"."""
    value, note = delta_value(row), delta_note(row)
    return f"{value} ({note})" if value and note else value or note


def delta_value(row: _Row | None) -> str:
    return percent_text(_number(row, "bd_rate_percent")) if has_delta(row) else ""


def has_delta(row: _Row | None) -> bool:
    return row is not None and not _why_not(row)


def delta_note(row: _Row | None) -> str:
    """Return the interval and number of clouds of a BD-rate, or the reason why there is none."""
    if row is None:
        return NO_COMMON_RANGE
    return _why_not(row) or ", ".join(filter(None, (_interval(row), _clouds(row))))


def holds_zero(row: _Row) -> bool:
    low, high = _ends(row)
    return not (low > 0 or high < 0)


def _why_not(row: _Row) -> str:
    compared = _count(row, "compared")
    if not compared:
        counts = {name: _number(row, name) for name in _REASONS}
        reasons = {name: count for name, count in counts.items() if count > 0}
        return (
            _REASONS[max(reasons, key=lambda name: reasons[name])] if reasons else NO_COMMON_RANGE
        )
    lacks_interval = isnan(_number(row, "bd_rate_percent_low"))
    return "no interval" if MIN_CLOUDS <= compared < FEW_CLOUDS and lacks_interval else ""


def _interval(row: _Row) -> str:
    if _count(row, "compared") == 1:
        return ""
    low, high = _ends(row)
    return "" if isnan(low) else f"{percent_text(low)} to {percent_text(high)}"


def _ends(row: _Row) -> tuple[float, float]:
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
    value = None if row is None else row.get(name)
    return nan if value in (None, "") else float(value)


def percent_text(value: float) -> str:
    """Return a signed percentage: −53.6 %, +118 %."""
    text = f"{abs(value):.0f}" if abs(value) >= 100 else f"{abs(value):.1f}"
    sign = "\N{MINUS SIGN}" if value < 0 else "+"
    return f"{sign}{text}\N{NO-BREAK SPACE}%"
