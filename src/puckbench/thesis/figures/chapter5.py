"""The figures of thesis chapter 5: the sensor, its errors and their models.

The input "residuals" is the table that `residual_table` describes, "scans" the one of
`laser_scans`; the drawings of geometry need none. The verdict on the models, which the thesis
does not have, is drawn where there are captures of a real sensor.
"""

from __future__ import annotations

from puckbench.figures.entry import STUDY, FigureEntry, at

_CATEGORY = "Sensor"
_INPUTS: dict[str, tuple[str, ...]] = {
    "geometry_diagrams": (),
    "laser_scans": ("scans",),
    "residual_violins": ("residuals",),
    "residual_incidence": ("residuals",),
    "model_verdict": ("compared_residuals", "model_distances"),
}


def _entry(function: str, number: str, title: str, *needs: str) -> FigureEntry:
    inputs = _INPUTS[function.split(":", maxsplit=1)[0]]
    return FigureEntry(
        f"puckbench.thesis.figures.{function}", inputs, title, _CATEGORY, number, (STUDY, *needs)
    )


FIGURES: dict[str, FigureEntry] = {
    "fig_5_1": _entry("geometry_diagrams:draw_sweep", "5.1", "The sweep in front of a wall"),
    "fig_5_2": _entry("laser_scans:draw_full_scan", "5.2", "Full scan at 5 m, by laser", at(5)),
    "fig_5_3": _entry(
        "laser_scans:draw_full_near_scan", "5.3", "Full scan at 1 m, by laser", at(1)
    ),
    "fig_5_4": _entry("laser_scans:draw_wall", "5.4", "Wall at 5 m, by laser", at(5)),
    "fig_5_5": _entry("laser_scans:draw_floor", "5.5", "Floor at 5 m, by laser", at(5)),
    "fig_5_6": _entry("laser_scans:draw_wall_side", "5.6", "Wall at 5 m from the side", at(5)),
    "fig_5_7": _entry("laser_scans:draw_wall_laser", "5.7", "One laser on the wall", at(5)),
    "fig_5_8": _entry("laser_scans:draw_floor_side", "5.8", "Floor at 5 m from the side", at(5)),
    "fig_5_9": _entry("laser_scans:draw_floor_laser", "5.9", "One laser on the floor", at(5)),
    "fig_5_10": _entry(
        "residual_violins:draw_surfaces", "5.10", "Plane residuals of walls and floors"
    ),
    "fig_5_11": _entry(
        "residual_violins:draw_wall_distances", "5.11", "Plane residuals of the wall per distance"
    ),
    "fig_5_12": _entry(
        "residual_violins:draw_floor_distances", "5.12", "Plane residuals of the floor per distance"
    ),
    "fig_5_13": _entry(
        "residual_violins:draw_floor_lasers", "5.13", "Plane residuals of the floor per laser"
    ),
    "fig_5_14": _entry(
        "residual_violins:draw_wall_lasers", "5.14", "Plane residuals of the wall per laser"
    ),
    "fig_5_15": _entry(
        "residual_incidence:draw_incidence", "5.15", "Plane residuals against incidence"
    ),
    "fig_5_16": _entry(
        "laser_scans:draw_wall_models", "5.16", "Error models on the wall at 5 m", at(5)
    ),
    "fig_5_17": _entry(
        "laser_scans:draw_floor_models", "5.17", "Error models on the floor at 5 m", at(5)
    ),
    "fig_5_18": _entry(
        "residual_violins:draw_models", "5.18", "Plane residuals of the error models"
    ),
    "fig_5_19": _entry(
        "residual_violins:draw_far_divergence",
        "5.19",
        "Effect of beam divergence at 30 m",
        at(30),
        "vlp16",
        "vlp16_divergence",
    ),
    "fig_5_20": _entry(
        "residual_incidence:draw_incidence_of_models",
        "5.20",
        "Plane residuals against incidence, per error model",
    ),
    "fig_5_21": _entry(
        "geometry_diagrams:draw_incidence_geometry", "5.21", "Incidence angle and plane residual"
    ),
    "model_verdict": _entry(
        "model_verdict:draw_verdict", "", "Real wall residuals against the error models"
    ),
}
