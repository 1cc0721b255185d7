"""The figures there are: what each draws, from which inputs, and where its function lives.

Listing imports neither matplotlib nor pandas, so that the workflow can plan with it.
"""

from __future__ import annotations

from puckbench.core.errors import InputError
from puckbench.figures.entry import FigureEntry
from puckbench.thesis.figures import chapter5, chapter6, findings

TABLES = (
    "metrics",
    "clouds",
    "scan_errors",
    "recovery",
    "residuals",
    "scans",
    "compared_residuals",
    "model_distances",
    "thesis_medians",
    "gpcc_scales",
)
EXAMPLES = ("example_object", "example_raw", "example_clean", "example_noisy")
"""Inputs that are prepared clouds (PLY files): one object, and one room in three forms."""

FIGURES: dict[str, FigureEntry] = {**chapter5.FIGURES, **chapter6.FIGURES, **findings.FIGURES}


def figure_entry(name: str) -> FigureEntry:
    """The entry of the figure called `name`; InputError when there is none."""
    if name not in FIGURES:
        raise InputError(f"unknown figure {name!r}; there are {', '.join(FIGURES)}")
    return FIGURES[name]
