from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.core.code import CLOUD_FILES, FIGURES
from puckbench.figures.registry import FIGURES as REGISTRY
from puckbench.steps.step import STEPS, Paths, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (*CLOUD_FILES, *FIGURES)


@STEPS.register("figure")
class Figure(Step):
    """Draw a registered figure.

    Parameters
    ----------
    figure
        Name of the figure, or place (``file.py:function``) of the user's own.
    style
        Layers of options of the style, each of which overrides earlier ones.
    codecs, datasets
        Names of the only codecs or data sets to show; empty shows all.
    """

    figure: str
    style: tuple[dict[str, Any], ...] = ()
    codecs: tuple[str, ...] = ()
    datasets: tuple[str, ...] = ()

    @classmethod
    def of_plan(cls, flow: Workflow, /, figure: str) -> PlannedStep:
        outputs = flow.outputs
        inputs = outputs.drawable[figure]
        step = cls(figure=REGISTRY.place_of(figure), style=outputs.figure_style(figure))
        examples = (Path(file) for file in inputs.values() if file.endswith(".ply"))
        clouds = " ".join(str(file.relative_to(flow.plan.results)) for file in examples)
        also = f"{outputs.styles_shown_by(figure)} {clouds}"
        return planned(step, flow.files.described(inputs), REGISTRY.module_of(figure), also=also)

    def plugins(self) -> Iterable[str | None]:
        return (self.figure,)

    def run(self, out: Paths, **inputs: Path) -> dict[str, Any]:
        """Draw the figure to the files `out`, in the formats of their suffixes.

        `inputs` are files of the tables and clouds that the figure shows, by the names of the
        parameters of the figure's function.
        """
        from puckbench.figures.drawing import draw_files
        from puckbench.figures.style import FigureStyle

        style = FigureStyle.from_config(*self.style)
        only = {"codec": self.codecs, "dataset": self.datasets}
        draw_files(self.figure, inputs, list(out), style, only)
        return {"figure": self.figure, "files": [str(path) for path in out]}
