"""`puckbench train_octree`: weights of the learned octree coder from clouds, resumable."""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from puckbench.cli.types import whole
from puckbench.cloud import read_cloud

_DIGITS = 5


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("clouds", type=Path, nargs="+", help="prepared clouds to learn from (PLY)")
    parser.add_argument("--out", type=Path, required=True, help="set of weights to write (.pcgw)")
    parser.add_argument("--steps", type=whole(1), default=3000, help="default: %(default)s")
    parser.add_argument("--cubes", type=whole(1), default=2, help="of a step; default: %(default)s")
    parser.add_argument("--side", type=whole(8), default=128, help="of a cube, in voxels")
    parser.add_argument(
        "--scales", type=float, nargs=2, default=[0.1, 1.1], help="of the grids, coarsest, finest"
    )
    parser.add_argument("--width", type=whole(4), default=32, help="of the network's features")
    parser.add_argument("--before", type=whole(1), default=1, help="convolutions, first group")
    parser.add_argument("--every", type=whole(1), default=100, help="steps between two savings")
    parser.add_argument("--seed", type=whole(0), default=1)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Train, going on from the checkpoint beside `out` where there is one, and export the set."""
    import torch

    from puckbench.codecs.octree_net.model import OctreeNet, Shape
    from puckbench.codecs.octree_net.training import Trainer, Training, train
    from puckbench.codecs.octree_net.weights import save_weights
    from puckbench.codecs.sparse.crew import crew

    torch.manual_seed(options.seed)
    model = OctreeNet(Shape(options.width, options.before))
    model.to("cuda" if torch.cuda.is_available() else "cpu")
    training = Training(options.steps, options.side, seed=options.seed)
    curve, start = options.out.with_suffix(".csv"), time.perf_counter()
    with crew() as workers, _curve(curve, options.every) as note:
        trainer = Trainer(model, training, workers)
        checkpoint = options.out.with_suffix(".pt")
        train(trainer, _examples(options).batch, checkpoint, options.every, note)
    card = _card(options, time.perf_counter() - start)
    save_weights(options.out, model.cpu(), card)
    return card


def _examples(options: argparse.Namespace) -> Any:
    from puckbench.codecs.octree_net.examples import Examples

    coarsest, finest = options.scales
    clouds = [read_cloud(path).xyz for path in options.clouds]
    return Examples(clouds, options.side, options.cubes, finest, coarsest, seed=options.seed)


def _card(options: argparse.Namespace, seconds: float) -> dict[str, Any]:
    """What the exported set says about itself; the time is that of this call alone."""
    names = ("steps", "cubes", "side", "scales", "seed")
    return {
        "data": sorted(path.name for path in options.clouds),
        **{name: getattr(options, name) for name in names},
        "seconds": round(seconds, 1),
    }


@contextmanager
def _curve(path: Path, every: int) -> Iterator[Callable[[int, float], None]]:
    """Notes each step: a row of a table, and now and then a line of progress."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh, start, recent = not path.exists(), time.perf_counter(), []
    with path.open("a", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        if fresh:
            rows.writerow(["step", "bits_per_voxel", "seconds"])

        def note(step: int, bits: float) -> None:
            seconds = time.perf_counter() - start
            rows.writerow([step, f"{bits:.{_DIGITS}g}", f"{seconds:.1f}"])
            file.flush()
            recent.append(bits)
            if step % every == 0:
                mean = sum(recent) / len(recent)
                recent.clear()
                print(f"step {step}: {mean:.3f} bits a voxel, {seconds:.0f} s", file=sys.stderr)  # noqa: T201

        yield note
