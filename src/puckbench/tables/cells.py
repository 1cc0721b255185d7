from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from puckbench.results.columns import column_named

if TYPE_CHECKING:
    import pandas as pd


def cell_text(value: Any) -> str:
    """Return the value of a table's cell as text.

    Numbers have four significant digits, and missing values are empty.
    """
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return str(value)
    if isinstance(value, float | np.floating):
        return "" if np.isnan(value) else _number_text(float(value))
    return "" if value is None or value is _missing() else str(value)


def decimals_of(spread: float) -> int:
    """Return the number of decimals with which a spread has two significant digits.

    It is below 0 for spreads from 99.5 on, of which the last digits are rounded away.

    Parameters
    ----------
    spread
        Width of an interval, or half of it, above 0.
    """
    return 1 - int(f"{spread:.1e}".partition("e")[2])


def interval_text(value: float, low: float, high: float) -> str:
    """Return a value with its interval as text, such as "1.004 (1.002 to 1.007)".

    All three numbers have so many decimals that the width of the interval has two digits.

    Parameters
    ----------
    value
        The value.
    low, high
        Ends of the interval.
    """
    decimals = max(0, decimals_of(high - low)) if high > low else 2
    return f"{value:.{decimals}f} ({low:.{decimals}f} to {high:.{decimals}f})"


def is_bookkeeping(values: pd.Series[Any]) -> bool:
    """Return whether a column is empty, or tells only how other values were obtained."""
    return column_named(str(values.name)).bookkeeping or bool(values.isna().all())


def _number_text(value: float) -> str:
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e12 else f"{value:.4g}"


def _missing() -> Any:
    import pandas as pd

    return pd.NA
