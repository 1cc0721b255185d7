from __future__ import annotations

import csv
import io
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.files import write_bytes

if TYPE_CHECKING:
    from pcc_networks.training.loop import BaseTrainer

_DIGITS = 5
_SECONDS_BETWEEN_LINES = 20.0


def resume(trainer: BaseTrainer[Any, Any], checkpoint: Path, anew: bool) -> None:
    """Continue a training from its checkpoint, if there is one.

    The checkpoint of another training, such as one with other code, is deleted if `anew` is true.
    Otherwise, `OtherTrainingError` is raised.
    """
    from pcc_networks.training.loop import OtherTrainingError

    if not checkpoint.exists():
        return
    try:
        trainer.resume(checkpoint)
    except OtherTrainingError:
        if not anew:
            raise
        checkpoint.unlink()
    else:
        text = f"{checkpoint}: going on after step {trainer.done}"
        print(text, file=sys.stderr)  # noqa: T201


class TrainingLog:
    """Records the losses of a training in a CSV file, and prints the progress.

    Parameters
    ----------
    trainer
        The trainer, which keeps the rows of earlier steps in its checkpoints.
    path
        CSV file to write.
    every
        Number of steps between two writings of the file.
    """

    def __init__(self, trainer: BaseTrainer[Any, Any], path: Path, every: int) -> None:
        self.trainer, self.path, self.every = trainer, path, every
        self._start = time.perf_counter() - self.seconds
        self._last_line_at = 0.0

    @property
    def seconds(self) -> float:
        """Duration of the training up to the last recorded step, in s."""
        rows = self.trainer.curve
        return rows[-1]["seconds"] if rows else 0.0

    def note(self, step: int, loss: Any) -> None:
        """Record the loss of a step; now and then, write the file and print a line."""
        seconds = round(time.perf_counter() - self._start, 1)
        row = {"step": step, **self.trainer.row(loss), "seconds": seconds}
        self.trainer.curve.append(row)
        if step % self.every == 0:
            self.write()
        if (
            step % self.every == 0
            or time.perf_counter() - self._last_line_at > _SECONDS_BETWEEN_LINES
        ):
            self._last_line_at = time.perf_counter()
            self._tell()

    def write(self) -> None:
        """Write the rows of all steps to the CSV file."""
        rows, text = self.trainer.curve, io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        if rows:
            writer.writerow(rows[0])
        for row in rows:
            writer.writerow(_short(value) for value in row.values())
        write_bytes(self.path, text.getvalue().encode())

    def _tell(self) -> None:
        rows = self.trainer.curve[-self.every :]
        cost = next(name for name in rows[0] if name != "step")
        mean = sum(row[cost] for row in rows) / len(rows)
        step = f"step {rows[-1]['step']} of {self.trainer.training.steps}"
        print(f"{step}: {cost} {mean:.4g}, {self.seconds:.0f} s", file=sys.stderr)  # noqa: T201


def _short(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.{_DIGITS}g}"
