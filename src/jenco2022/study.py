"""The sensor study of chapter 5, which scans a wall and a floor with each error model."""

from __future__ import annotations

from functools import cached_property

from jenco2022.steps.study_table import COMPARED_RESIDUALS
from puckbench.planning.study import STUDIES, Study

_OF_CAPTURES = {
    "compared_residuals": COMPARED_RESIDUALS,
    "compared": COMPARED_RESIDUALS,
    "model_distances": "model_distances",
}
"""Tables that compare error models with captures, by the name of a figure's input."""


@STUDIES.register("sensor_study")
class ResidualStudy(Study):
    """The tables of the sensor study."""

    input_names = ("residuals", "scans", *_OF_CAPTURES)

    @cached_property
    def gathered(self) -> dict[str, tuple[str, ...]]:
        """Files of all error models and recordings that are joined, by name of the table."""
        models, captures = self.study.models, self.capture_files
        residuals = tuple(f"residuals/models/{model}.parquet" for model in models)
        tables = {
            "residuals": (*residuals, *captures),
            "scans": tuple(f"wall_points/{model}.parquet" for model in models),
        }
        return {**tables, **({COMPARED_RESIDUALS: captures} if captures else {})}

    @property
    def inputs(self) -> dict[str, str]:
        """Names of the study's tables, by the name of the input that they supply."""
        names = ["residuals", *(["scans"] if self.study.shown_m else [])]
        can_compare = not self.plan.has_failed("tables", COMPARED_RESIDUALS)
        of_captures = _OF_CAPTURES if self.study.captures and can_compare else {}
        return {name: name for name in names} | of_captures
