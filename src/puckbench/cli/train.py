"""`puckbench train`: weights of a learned codec from clouds, resumable."""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from puckbench.cli.types import whole
from puckbench.cloud import read_cloud


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("clouds", type=Path, nargs="+", help="prepared clouds to learn from (PLY)")
    parser.add_argument("--out", type=Path, required=True, help="set of weights to write (.pcgw)")
    parser.add_argument("--start", type=Path, help="set of weights to start from, of the same shape")
    parser.add_argument("--alphas", type=float, nargs="+", default=[0.25, 0.5, 1, 2, 4, 6, 10])
    parser.add_argument("--steps", type=whole(1), default=2000, help="default: %(default)s")
    parser.add_argument("--cubes", type=whole(1), default=4, help="of a step; default: %(default)s")
    parser.add_argument("--side", type=whole(8), default=64, help="of a cube, in voxels")
    parser.add_argument("--thinnest", type=float, default=1.0, help="least share of voxels kept")
    parser.add_argument(
        "--widths", type=whole(4), nargs=4, default=[16, 32, 64, 32], help="of the network"
    )
    parser.add_argument("--every", type=whole(1), default=100, help="steps between two savings")
    parser.add_argument("--seed", type=whole(0), default=1)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Train, going on from the checkpoint beside `out` where there is one, and export the set."""
    import torch

    from puckbench.codecs.pcgcv2.model import PCGCv2, Shape
    from puckbench.codecs.pcgcv2.training import Trainer, Training, spread_gains, train
    from puckbench.codecs.pcgcv2.weights import load_weights, save_weights
    from puckbench.codecs.sparse.crew import crew

    alphas = tuple(sorted(options.alphas))
    torch.manual_seed(options.seed)
    model = PCGCv2(Shape(widths=tuple(options.widths), rates=len(alphas)))
    if options.start is None:
        spread_gains(model, alphas)
    else:
        model.load_state_dict(load_weights(options.start).model.state_dict())
    model.to("cuda" if torch.cuda.is_available() else "cpu")
    training = Training(alphas, options.steps, seed=options.seed)
    start, curve = time.perf_counter(), options.out.with_suffix(".csv")
    with crew() as workers, Curve(curve, start, options.every) as told:
        trainer = Trainer(model, training, workers)
        checkpoint = options.out.with_suffix(".pt")
        train(trainer, _examples(options).batch, checkpoint, options.every, told.note)
    card = _card(options, time.perf_counter() - start)
    save_weights(options.out, model.cpu(), alphas, card)
    return card


def _examples(options: argparse.Namespace) -> Any:
    from puckbench.codecs.pcgcv2.examples import Examples

    clouds = [np.rint(read_cloud(path).xyz).astype(np.int64) for path in options.clouds]
    return Examples(clouds, options.side, options.cubes, thinnest=options.thinnest, seed=options.seed)


def _card(options: argparse.Namespace, seconds: float) -> dict[str, Any]:
    """What the exported set says about itself; the time is that of this call alone."""
    return {
        "data": sorted(path.name for path in options.clouds),
        "start": options.start and options.start.name,
        "alphas": sorted(options.alphas),
        "steps": options.steps,
        "cubes": options.cubes,
        "side": options.side,
        "thinnest": options.thinnest,
        "seed": options.seed,
        "seconds": round(seconds, 1),
    }


class Curve:
    """The training curve as a table, a row for each step, and a line of progress now and then."""

    def __init__(self, path: Path, start: float, every: int) -> None:
        self.path = path
        self.start = start
        self.every = every

    def __enter__(self) -> Curve:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        fresh = not self.path.exists()
        self.file = self.path.open("a", newline="", encoding="utf-8")
        self.rows = csv.writer(self.file)
        if fresh:
            names = ("step", "loss", "bits_stride_4", "bits_stride_2", "bits_stride_1", "bpp")
            self.rows.writerow([*names, "seconds"])
        return self

    def note(self, step: int, loss: Any) -> None:
        """Add the row of a step."""
        values = [float(v) for v in (loss.total, *loss.entropies, loss.bpp)]
        seconds = time.perf_counter() - self.start
        self.rows.writerow([step, *(f"{value:.5g}" for value in values), f"{seconds:.1f}"])
        self.file.flush()
        if step % self.every == 0:
            print(f"step {step}: loss {values[0]:.3g}, {seconds:.0f} s", file=sys.stderr)  # noqa: T201

    def __exit__(self, *_: object) -> None:
        self.file.close()
