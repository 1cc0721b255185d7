"""Measures of tasks: by which column, unit, direction and margin a task is judged after coding.

A task of a robot on single clouds is a metric, one on drives is a task. Both declare what the table
``perception_bits`` compares where they are registered::

    @METRICS.register("ground", columns=COLUMNS, measures=[
        TaskMeasure("ground", "Ground segmentation", "ground_iou_percent",
                    undecoded="ground_undecoded_iou_percent", unit="%", better=HIGHER, margin=1.0),
    ])
    @TASKS.register("loops", columns=COLUMNS, measures=[
        TaskMeasure("loops", "Loop closures", "loops_f1_percent", unit="%", better=HIGHER,
                    margin=2.0),
    ])
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from pydantic import Field, PositiveFloat

from pointkit.errors import InputError, among
from pointkit.models import Model
from puckbench.results.columns import HIGHER


class TaskMeasure(Model):
    """By what a task is judged after coding, and how much worse it may get."""

    name: str = Field(description="Name of the task in tables and under `task_margins`.")
    title: str = Field(description="What the task is called in figures.")
    column: str = Field(description="Column of results with the value after coding.")
    undecoded: str = Field(
        "",
        description="Column, in the same row, with the value without coding. Tasks of drives leave "
        "it empty: a drive that was not coded has a row of its own.",
    )
    unit: str = Field("", description="Unit of both columns.")
    better: Literal["higher", "lower"] = Field(
        "higher", description="Whether higher or lower values are better."
    )
    margin: PositiveFloat = Field(
        description="Largest loss, in the unit, that counts as none. It is fixed before results "
        "are seen; `task_margins` in the configuration replaces it."
    )

    def loss(self, undecoded: float, decoded: float) -> float:
        """Return how much worse a value after coding is than without; negative if it is better."""
        return undecoded - decoded if self.better == HIGHER else decoded - undecoded


def with_margins(
    measures: Iterable[TaskMeasure], margins: Mapping[str, float]
) -> tuple[TaskMeasure, ...]:
    """Return measures with the margins of a configuration.

    Parameters
    ----------
    measures
        The measures.
    margins
        Margins by name of the measure, which replace those of the measures.

    Raises
    ------
    InputError
        There is no measure of a name.
    """
    listed = tuple(measures)
    names = [each.name for each in listed]
    for name in margins:
        if name not in names:
            raise InputError(f"no measure '{name}'{among(name, names)}")
    return tuple(each.replaced(margin=margins.get(each.name, each.margin)) for each in listed)
