from __future__ import annotations

from collections.abc import Mapping
from math import isnan, nan
from typing import Any

from puckbench.metrics.bjontegaard import LITTLE_OVERLAP, MIN_POINTS, NO_COMMON_RANGE
from puckbench.metrics.statistics import NO_VERDICT

_REASONS = {
    "no_common_range": NO_COMMON_RANGE,
    "little_overlap": LITTLE_OVERLAP,
    "too_few_points": f"fewer than {MIN_POINTS} lossy rates",
}
_Row = Mapping[Any, Any]


def delta_text(row: _Row | None) -> str:
    """Return the BD-rate in a row of the table ``bd_rate`` as text.

    For example, "−50.0 % (−60.0 % to −40.0 %, 6 scenes, better)". With fewer than six scenes, the
    range is that of the scenes instead of a confidence interval, and the verdict is "no verdict".
    Without a BD-rate, the text is the reason.

    Parameters
    ----------
    row
        The row, or None if there is none.
    """
    value, note = delta_value(row), delta_note(row)
    return f"{value} ({note})" if value and note else value or note


def delta_value(row: _Row | None) -> str:
    """Return the BD-rate in a row of the table ``bd_rate`` as a percentage, or an empty text."""
    return percent_text(_number(row, "bd_rate_percent")) if has_delta(row) else ""


def has_delta(row: _Row | None) -> bool:
    """Return whether a row of the table ``bd_rate`` has a BD-rate."""
    return row is not None and _count(row, "scenes") > 0


def delta_note(row: _Row | None) -> str:
    """Return the range, number of scenes and verdict of a BD-rate, or why there is none."""
    if row is None:
        return "not measured"
    if not has_delta(row):
        counts = {name: _number(row, name) for name in _REASONS}
        most = max(counts, key=lambda name: counts[name])
        return _REASONS[most] if counts[most] > 0 else NO_COMMON_RANGE
    return ", ".join(filter(None, (_ends(row), _scenes(row), str(row["verdict"]))))


def _ends(row: _Row) -> str:
    names = ("least", "most") if row["verdict"] == NO_VERDICT else ("low", "high")
    low, high = (_number(row, f"bd_rate_percent_{name}") for name in names)
    return "" if isnan(low) or low == high else f"{percent_text(low)} to {percent_text(high)}"


def _scenes(row: _Row) -> str:
    scenes, compared, clouds = (_count(row, name) for name in ("scenes", "compared", "clouds"))
    text = "one scene" if scenes == 1 else f"{scenes} scenes"
    return f"{text}, {compared} of {clouds} clouds" if compared < clouds else text


def _count(row: _Row, name: str) -> int:
    return int(float(row[name]))


def _number(row: _Row | None, name: str) -> float:
    value = None if row is None else row.get(name)
    return nan if value in (None, "") else float(value)


def percent_text(value: float) -> str:
    """Return a percentage with its sign as text, such as "−53.6 %" or "+118 %"."""
    text = f"{abs(value):.0f}" if abs(value) >= 100 else f"{abs(value):.1f}"
    sign = "\N{MINUS SIGN}" if value < 0 else "+"
    return f"{sign}{text}\N{NO-BREAK SPACE}%"
