from __future__ import annotations

from math import floor, log10
from typing import Any

import numpy as np


def cell_text(value: Any) -> str:
    """Return a cell's text: four significant digits for numbers, empty if missing."""
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return str(value)
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else _number_text(float(value))
    return "" if value is None or value is _missing() else str(value)


def interval_text(value: float, low: float, high: float) -> str:
    """Return a value with its interval as text, such as "1.004 (1.002 to 1.007)".

    The width of the interval is given with two digits, which determines the number of decimals.
    """
    decimals = max(0, 1 - floor(log10(high - low))) if high > low else 2
    return f"{value:.{decimals}f} ({low:.{decimals}f} to {high:.{decimals}f})"


def _number_text(value: float) -> str:
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e12 else f"{value:.4g}"


def _missing() -> Any:
    import pandas as pd

    return pd.NA
