"""Our G-PCC coder against the reference software, both ways, over clouds, profiles and scales.

    python -m benchmarks.checks.gpcc_crosscheck TMC3 [--full] [--clouds NAME ...]
        [--profiles NAME ...] [--rates NAME ...]

For each case: what TMC3 decodes from our stream must be the grid points that were coded, what we
decode from TMC3's stream must be what TMC3 decodes from it, and our stream may be at most 0.5 %
larger. --full adds rooms of 1,152,000 points. Exit status 1 if any case fails.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator

import numpy as np
from benchmarks.clouds import grown, sampled_object, scanned_room
from benchmarks.tmc3 import Checked, Tally, differ, judged

from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import decoded, encoded
from puckbench.codecs.registry import open_codec

SCALES = {"e3": 0.125, "e4": 1 / 6, "e5": 0.375, "e6": 0.5, "e7": 0.9, "e8": 1.0}
RATES = {name: {"scale": scale} for name, scale in SCALES.items()}


def checked(ours: Codec, reference: Codec, points: Floats, rate: str) -> Checked:
    cloud = PointCloud(points, about={"size": 1024})
    mine, theirs = encoded(ours, cloud, rate), encoded(reference, cloud, rate)
    expected = decoded(reference, theirs).xyz
    faults = {
        "TMC3 decodes ours otherwise": differ(decoded(reference, mine).xyz, expected),
        "we decode TMC3's otherwise": differ(decoded(ours, theirs).xyz, expected),
        "we decode ours otherwise": differ(decoded(ours, mine).xyz, expected),
    }
    return judged(mine, theirs, faults)


def clouds(full: bool) -> Iterator[tuple[str, Floats]]:
    noisy, sampled = scanned_room("vlp16_divergence", 1.0), sampled_object(50_000)
    yield "noisy room", noisy
    yield "clean room", scanned_room("none", 1.0)
    yield "object", sampled
    yield "sparse", noisy[::37]
    yield "16 bits", grown(noisy[::3], 16)
    yield "20 bits", grown(noisy[::7], 20)
    yield "negative", sampled - 700
    yield "plane", sampled * [1, 1, 0]
    yield "line", sampled[:500] * [0, 1, 0]
    yield "one point", sampled[:1]
    yield "many of few", np.repeat(sampled[:50], 40, axis=0)
    yield "filled", np.stack(np.meshgrid(*[np.arange(24.0)] * 3), axis=-1).reshape(-1, 3)
    if full:
        for errors in ("none", "vlp16_divergence"):
            yield f"whole room, {errors}", scanned_room(errors)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tmc3")
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--clouds", nargs="+", help="these alone, by name")
    parser.add_argument("--profiles", nargs="+", default=["minimal", "ctc", "defaults"])
    parser.add_argument("--rates", nargs="+", choices=list(RATES), default=list(RATES))
    options = parser.parse_args()
    tally = Tally()
    for name, points in clouds(options.full):
        if options.clouds and name not in options.clouds:
            continue
        choices = itertools.product(
            options.profiles, ("merged", "kept"), ("nearest", "truncate"), options.rates
        )
        for profile, duplicates, rounding, rate in choices:
            common = {"profile": profile, "duplicates": duplicates, "rounding": rounding}
            reference = {"options": {**common, "program": options.tmc3}, "rates": RATES}
            found = checked(
                open_codec("gpcc", {"options": common, "rates": RATES}),
                open_codec("tmc13", reference),
                points,
                rate,
            )
            where = f"{name}, {profile}, {duplicates}, {rounding}, scale {SCALES[rate]:g}"
            tally.add(where, found)
    tally.end()


if __name__ == "__main__":
    main()
