from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from puckbench.core.code import CLOUD_FILES, FIGURES
from puckbench.jobs.registry import JOBS, Job

CODE = (*CLOUD_FILES, *FIGURES)


@JOBS.register("figure")
class Figure(Job):
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

    def plugins(self) -> Iterable[str | None]:
        return (self.figure,)

    def run(self, out: tuple[Path, ...], **inputs: Path) -> dict[str, Any]:
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
