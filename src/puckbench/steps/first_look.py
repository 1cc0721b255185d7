from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.core.code import CLOUD_FILES, TABLES
from puckbench.figures.registry import FIGURES as REGISTRY
from puckbench.steps.results_table import JoiningStep
from puckbench.steps.step import STEPS, Paths, PlannedStep, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (*CLOUD_FILES, *TABLES, "puckbench.steps.results_table")


@STEPS.register("first_look")
class FirstLook(JoiningStep):
    """Draw the first figures of a run from the results of one codec.

    `style` has layers of options of the figures' style, each of which overrides earlier ones.
    """

    style: tuple[dict[str, Any], ...] = ()

    @classmethod
    def of_plan(cls, flow: Workflow, /) -> PlannedStep:
        outputs = flow.outputs
        step = cls(names=outputs.first_rows, style=outputs.style)
        inputs = {"rows": [f"{flow.plan.results}/{name}" for name in step.names]}
        modules = map(REGISTRY.module_of, outputs.first_figures)
        return planned(step, inputs, *modules, also=outputs.codec_styles)

    def run(self, results: Path, parquet: Path, out: Paths) -> dict[str, Any]:
        """Write the table of results to `parquet`, draw the figures, and return the row count.

        `results` is the results folder. `out` are the files of the figures, each of which has the
        name of its figure.
        """
        from pointkit.tables import write_table
        from puckbench.figures.drawing import draw_files
        from puckbench.figures.style import FigureStyle
        from puckbench.tables.gathered import metrics

        table = metrics(self.files(results))
        write_table(table, parquet)
        style = FigureStyle.from_config(*self.style)
        for path in out:
            draw_files(path.stem, {"metrics": parquet}, [path], style)
        return {"rows": len(table)}
