"""A figure drawn from tables and clouds, by its name in the registry."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from puckbench.jobs.registry import JOBS, Job


@JOBS.register("figure")
class Figure(Job):
    """Draw a figure: its name, and the layers of its style."""

    figure: str
    style: tuple[dict[str, Any], ...] = ()

    def plugins(self) -> Iterable[str | None]:
        """The figure."""
        return (self.figure,)

    def run(self, out: tuple[Path, ...], **inputs: Path) -> dict[str, Any]:
        """Draw and write the figure (PDF, PNG); inputs: the file of each by its name."""
        from puckbench.figures.drawing import draw_files
        from puckbench.figures.style import FigureStyle

        draw_files(self.figure, inputs, list(out), FigureStyle.from_config(*self.style))
        return {"figure": self.figure, "files": [str(path) for path in out]}
