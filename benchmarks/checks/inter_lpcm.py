"""Bits of Inter-LPCM on its authors' 20 turns, as code lengths of their models and as our bytes.

    python -m benchmarks.checks.inter_lpcm FOLDER [--turns 2] [--plain] [--out rows.csv]

FOLDER is a copy of the authors' repository: weights, ``test/*.bin`` (turns) and
``test_matrix/*.bin`` (poses). Each turn is predicted from the one before, as decoded before its
corrections. A turn takes about two minutes on one thread.

Columns are bits: code lengths of azimuths and radii with the contexts of the authors' program,
which runs from line to line; our bytes of each part; and their sum with the header.
The authors' program would predict the first turn from the last; the two differ so much (33.5 dB,
where it asks for 35) that it codes the first turn alone, as this script does.

With --plain, each turn is coded alone, radii and elevations are predicted by the point before, and
all symbols are coded by context mixing: no network but those of the two code lengths.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pcc_networks.inter_lpcm.codec import USUAL_AZIMUTH_STEPS, CodedTurn, encode_turn
from pcc_networks.inter_lpcm.mixing import ElevationCoder, encode_corrections
from pcc_networks.inter_lpcm.prediction import (
    ELEVATION,
    RADIUS,
    SYMBOLS_PER_UNIT,
    Reference,
    points_at_steps,
    reference_of,
    rounded,
)
from pcc_networks.inter_lpcm.stream import read_stream
from pcc_networks.inter_lpcm.symbols import SymbolNetwork, code_length, contexts_of
from pcc_networks.inter_lpcm.turn import Lines, cartesian, lines_of
from pcc_networks.inter_lpcm.weights import LpcmWeights, load_weights
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.metrics.geometry import distortion
from puckbench.metrics.psnr import mpeg_psnr

STEP_M = 0.02
"""Step of the corrections in the authors' program."""
PEAK_M = 59.7
"""Peak of the authors' PSNR."""
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
    for file in turn_files(folder)[:turns]:
        reference = None
        if before is not None:
            reference = _reference(before, folder / "test_matrix" / file.name)
        coded = encode_turn(_points(file), weights, STEP_M, reference)
        # the authors' program stores the turn in single precision
        before = cartesian(coded.lines).astype(np.float32)
        yield file.stem, coded


def turn_files(folder: Path) -> list[Path]:
    """Return the files of the turns in the authors' repository, in order."""
    return sorted((folder / "test").glob("*.bin"))


def _points(file: Path) -> Floats:
    return np.fromfile(file, "<f4").reshape(-1, 4)[:, :3].astype(np.float64)


def _reference(points: Floats, file: Path) -> Reference:
    return reference_of(points, np.fromfile(file, "<f4").reshape(4, 4).astype(np.float64))


def plain_row(file: Path, weights: LpcmWeights) -> Row:
    """Return the bits of a turn whose symbols are coded by context mixing, and its D1 PSNR."""
    points = _points(file)
    lines = lines_of(points)
    starts = lines.starts
    first = starts[:-1]
    azimuth = np.diff(lines.azimuth, prepend=0)
    azimuth[first] = USUAL_AZIMUTH_STEPS
    none = np.zeros(len(points), np.int64)
    symbols = {RADIUS: none.copy(), ELEVATION: none.copy()}
    values = {RADIUS: lines.radius, ELEVATION: lines.elevation}
    decoded = {kind: np.zeros(len(points)) for kind in symbols}
    before = {kind: values[kind][first].copy() for kind in symbols}
    names = ("azimuth", "radius", "elevation")
    coders = {name: ElevationCoder.writer(len(first), len(points)) for name in names}
    for at, rows in points_at_steps(starts):
        for kind, coded in symbols.items():
            coded[at] = rounded(kind, values[kind][at], before[kind][rows])
            before[kind][rows] += coded[at] / SYMBOLS_PER_UNIT[kind]
            decoded[kind][at] = before[kind][rows]
        radii = symbols[RADIUS][at]
        coders["azimuth"].code(azimuth[at] - USUAL_AZIMUTH_STEPS, rows, none[at])
        coders["radius"].code(radii, rows, none[at])
        coders["elevation"].code(symbols[ELEVATION][at], rows, radii)
    before_corrections = cartesian(
        Lines(lines.azimuth, decoded[ELEVATION], decoded[RADIUS], starts)
    )
    corrections = np.rint((points - before_corrections) / STEP_M).astype(np.int64)
    errors = distortion(PointCloud(points), before_corrections + corrections * STEP_M)
    sizes = {name: 8 * len(coder.written()) for name, coder in coders.items()}
    sizes["corrections"] = 8 * len(encode_corrections(corrections, lines.azimuth))
    azimuths = np.delete(azimuth, first)
    return {
        "turn": file.stem,
        "points": len(points),
        "lines": len(first),
        "azimuth_length": _length(azimuths, USUAL_AZIMUTH_STEPS, weights.azimuth_symbols),
        "radius_length": _length(symbols[RADIUS], 0, weights.radius_symbols),
        **sizes,
        "total": sum(sizes.values()),
        "d1_psnr": round(mpeg_psnr(errors, PEAK_M)["d1_psnr"], 3),
    }


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
    parser.add_argument("--plain", action="store_true", help="without networks, each turn alone")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    folder, turns = arguments.folder, arguments.turns
    weights = load_weights(folder)
    rows: Iterator[Row]
    if arguments.plain:
        rows = (plain_row(file, weights) for file in turn_files(folder)[:turns])
    else:
        rows = (row_of(*turn, weights) for turn in coded_turns(folder, weights, turns))
    lines: list[str] = []
    for row in rows:
        new = ([",".join(row)] if not lines else []) + [",".join(map(str, row.values()))]
        print(*new, sep="\n", flush=True)
        lines += new
        if arguments.out:
            arguments.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
