from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from puckbench.jobs.registry import JOBS, Job


@JOBS.register("figure")
class Figure(Job):
    """Draw a registered figure in a style merged from several layers of options."""

    figure: str
    style: tuple[dict[str, Any], ...] = ()

    def plugins(self) -> Iterable[str | None]:
        return (self.figure,)

    def run(self, out: tuple[Path, ...], **inputs: Path) -> dict[str, Any]:
        from puckbench.figures.drawing import draw_files
        from puckbench.figures.style import FigureStyle

        draw_files(self.figure, inputs, list(out), FigureStyle.from_config(*self.style))
        return {"figure": self.figure, "files": [str(path) for path in out]}
