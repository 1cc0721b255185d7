"""Bits of Inter-LPCM on its authors' 20 turns, as code lengths of their models and as our bytes.

    python -m benchmarks.checks.inter_lpcm FOLDER [--turns 2] [--out rows.csv]

FOLDER is a copy of the authors' repository: weights, ``test/*.bin`` (turns) and
``test_matrix/*.bin`` (poses). Each turn is predicted from the one before, as decoded before its
corrections. A turn takes about three minutes on one thread.

Columns are bits: code lengths of azimuths and radii with the contexts of the authors' program,
which runs from line to line; our bytes of each part; and their sum with the header.
The authors' program would predict the first turn from the last; the two differ so much (33.5 dB,
where it asks for 35) that it codes the first turn alone, as this script does.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pcc_networks.inter_lpcm.codec import USUAL_AZIMUTH_STEPS, CodedTurn, encode_turn
from pcc_networks.inter_lpcm.prediction import Reference, reference_of
from pcc_networks.inter_lpcm.stream import read_stream
from pcc_networks.inter_lpcm.symbols import SymbolNetwork, code_length, contexts_of
from pcc_networks.inter_lpcm.turn import cartesian
from pcc_networks.inter_lpcm.weights import LpcmWeights, load_weights
from pointkit.geometry.cloud import Floats

STEP_M = 0.02
"""Step of the corrections in the authors' program."""
Row = dict[str, float | int | str]


def coded_turns(folder: Path, weights: LpcmWeights, turns: int) -> Iterator[tuple[str, CodedTurn]]:
    """Yield the name of each turn of the authors' repository, and the turn as it is coded.

    Parameters
    ----------
    folder
        Copy of the repository.
    weights
        Its weights.
    turns
        Number of turns, from the first on.
    """
    before = None
    for file in sorted((folder / "test").glob("*.bin"))[:turns]:
        reference = None
        if before is not None:
            reference = _reference(before, folder / "test_matrix" / file.name)
        coded = encode_turn(_points(file), weights, STEP_M, reference)
        # the authors' program stores the turn in single precision
        before = cartesian(coded.lines).astype(np.float32)
        yield file.stem, coded


def _points(file: Path) -> Floats:
    return np.fromfile(file, "<f4").reshape(-1, 4)[:, :3].astype(np.float64)


def _reference(points: Floats, file: Path) -> Reference:
    return reference_of(points, np.fromfile(file, "<f4").reshape(4, 4).astype(np.float64))


def row_of(name: str, coded: CodedTurn, weights: LpcmWeights) -> Row:
    """Return the bits of a turn, by part."""
    starts = coded.lines.starts
    azimuths = np.delete(coded.azimuth, starts[:-1])
    parts = read_stream(coded.stream)
    sizes = {
        part: 8 * len(data)
        for part, data in (
            ("azimuth", parts.azimuth.data),
            ("radius", parts.radius.data),
            ("elevation", parts.elevation),
            ("corrections", parts.corrections),
        )
    }
    total = 8 * len(coded.stream)
    return {
        "turn": name,
        "points": len(coded.azimuth),
        "lines": len(starts) - 1,
        "azimuth_length": _length(azimuths, USUAL_AZIMUTH_STEPS, weights.azimuth_symbols),
        "radius_length": _length(coded.radius, 0, weights.radius_symbols),
        **sizes,
        "header": total - sum(sizes.values()),
        "total": total,
    }


def _length(symbols: np.ndarray, before: int, layers: tuple) -> float:  # type: ignore[type-arg]
    """Return the code length of a sequence of symbols with a network's distributions, in bits."""
    distributions = SymbolNetwork(layers).distributions(contexts_of(symbols, before))
    return round(code_length(symbols, distributions), 1)


def main() -> None:
    """Write a row for each turn."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--turns", type=int, default=20)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    weights = load_weights(arguments.folder)
    lines: list[str] = []
    for name, coded in coded_turns(arguments.folder, weights, arguments.turns):
        row = row_of(name, coded, weights)
        new = ([",".join(row)] if not lines else []) + [",".join(map(str, row.values()))]
        print(*new, sep="\n", flush=True)
        lines += new
        if arguments.out:
            arguments.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
