"""Tables and clouds that look like results of four data sets, for the tests of the figures."""

from __future__ import annotations

from itertools import count

import numpy as np
import pandas as pd

from pointkit.geometry.cloud import PointCloud
from pointkit.seeding import generator

DATASETS = ("capod", "s3dis_raw", "s3dis_clean", "s3dis_noisy")

_CD = {
    "draco": (433, 113, 26, 6.7, 1.6, 0.34, 0.086, 0.022),
    "gpcc": (6.2, 1.7, 0.81, 0.36, 0.36, 0.29, 0.3, 0.29),
    "pcgcv1": (2.8, 1.4, 1.9, 3.1, 5, 7.3),
    "pcgcv2": (3.7, 1.06, 0.66, 0.5, 0.42, 0.41, 0.4),
}
_BPP = {"draco": (0.016, 8), "gpcc": (0.057, 4.8), "pcgcv1": (0.1, 1.95), "pcgcv2": (0.031, 1.7)}
_FACTORS = dict(zip(DATASETS, (1, 0.9, 1.1, 0.6), strict=True))
CD_MEDIANS = {
    (dataset, codec): [factor * cd for cd in medians]
    for dataset, factor in _FACTORS.items()
    for codec, medians in _CD.items()
}
"""Medians of the Chamfer distance in the order of the rates, by data set and codec."""
_ENCODE_S = {"draco": (0.25, 1.2), "gpcc": (1.2, 1.3), "pcgcv1": (20, 1.1), "pcgcv2": (13, 1.02)}
_NOISE_FLOOR = 2.4
SCALE = 200.0
"""Grid units in a metre."""


def _with_metres(row: dict[str, float]) -> dict[str, float]:
    """Add distances in metres to a row with squared ones in grid units."""
    metres = {"d1_rms_m": "cd_point", "d2_rms_m": "cd_plane"}
    metres["hausdorff_plane_m"] = "hausdorff_sq_plane"
    return row | {
        f"{prefix}{name}": row[f"{prefix}{squared}"] ** 0.5 / SCALE
        for prefix in ("", "truth_")
        for name, squared in metres.items()
        if f"{prefix}{squared}" in row
    }


def metrics_table(clouds: int = 12) -> pd.DataFrame:
    """Results of four data sets and codecs, with so many clouds per data set."""
    rng = generator(7, "lookalike")
    rows = []
    for (dataset, codec), medians in CD_MEDIANS.items():
        rates = np.geomspace(*_BPP[codec], len(medians))
        for cloud in range(clouds):
            spread = np.exp(0.25 * rng.normal(size=4))
            for rate, cd, bpp in zip(count(1), medians, rates, strict=False):
                start, growth = _ENCODE_S[codec]
                seconds = start * growth**rate * spread[2]
                far = _NOISE_FLOOR if dataset == "s3dis_noisy" else np.nan
                to_scan = {
                    "cd_plane": cd * spread[0],
                    "cd_point": 2 * cd * spread[0],
                    "hausdorff_sq_plane": 8 * cd * spread[1],
                    "acd_ab_plane": 0.8 * cd * spread[0],
                    "acd_ba_plane": 1.2 * cd * spread[0],
                }
                to_truth = {f"truth_{key}": value + far for key, value in to_scan.items()}
                rows.append(
                    {
                        "dataset": dataset,
                        "cloud": f"cloud_{cloud}",
                        "codec": codec,
                        "rate": f"r{rate}",
                        "scale": SCALE,
                        "bpp": bpp * spread[3],
                        **{f"clean_{key}": value + 1.2 * far for key, value in to_scan.items()},
                        **_with_metres(to_scan | to_truth),
                        "encode_s": seconds,
                        "timed_alone": True,
                        "repeats": 3,
                        "decode_s": 0.6 * seconds,
                    }
                )
    return pd.DataFrame(rows)


def scan_errors_table() -> pd.DataFrame:
    """How far three noisy scans are from the truth themselves; one of them has outliers."""
    measures = ("cd_plane", "cd_point", "hausdorff_sq_plane", "acd_ab_plane", "acd_ba_plane")
    rows = [
        {
            "dataset": "s3dis_noisy",
            "cloud": f"cloud_{i}",
            "scale": SCALE,
            **_with_metres({f"truth_{name}": factor * _NOISE_FLOOR for name in measures}),
            **{f"clean_{name}": factor * 1.2 * _NOISE_FLOOR for name in measures},
        }
        for i, factor in enumerate((0.9, 1, 50))
    ]
    return pd.DataFrame(rows)


def sweeps_table(clouds: int = 4) -> pd.DataFrame:
    """Results of spins under two error models with two codecs, each a bit more for half the error.

    Puck's last rate is without loss; spins of a recording have no truth.
    """
    rng = generator(7, "sweeps")
    rows = []
    for dataset, far_m in (("rooms", 0.0), ("rooms_vlp16", 0.01), ("recording", np.nan)):
        for cloud in range(clouds):
            spread = float(np.exp(0.1 * rng.normal()))
            for codec, most in (("gpcc", 4.0), ("puck", 1.0)):
                for number, length in enumerate((100, 50, 20, 10)):
                    lossless = codec == "puck" and length == 10
                    error = 0.0 if lossless else length / 3000 * spread
                    rows.append(
                        {
                            "dataset": dataset,
                            "frame": "metric",
                            "cloud": f"cloud_{cloud}",
                            "codec": codec,
                            "rate": f"{length}mm",
                            "bpp": most * (number + 1) * spread,
                            "bpp_geometry": 0.6 * most * (number + 1) * spread,
                            "bpp_reflectance": 0.4 * most * (number + 1) * spread,
                            "reflectance_psnr": np.nan if lossless else 20.0 + 5 * number,
                            "reflectance_lossless": lossless,
                            "points_in": 1000,
                            "points_out": 1000,
                            "d1_rms_m": error,
                            "range_rms_mm": 1700 * error,
                            "truth_d2_rms_m": np.hypot(error, far_m),
                        }
                    )
    return pd.DataFrame(rows)


def sweeps_scan_errors_table() -> pd.DataFrame:
    """The spins themselves: without errors, and with some of 10 mm."""
    rows = [("rooms", 0.0005), ("rooms_vlp16", 0.01)]
    return pd.DataFrame(
        {"dataset": name, "frame": "metric", "cloud": "cloud_0", "truth_d2_rms_m": far}
        for name, far in rows
    )


def sweeps_clouds_table(clouds: int = 4) -> pd.DataFrame:
    """The spins' clouds, with the entropy of their noise; a recording's is not known."""
    rows = [("rooms", "none", 0.0), ("rooms_vlp16", "vlp16", 4.4), ("recording", None, np.nan)]
    return pd.DataFrame(
        {
            "dataset": dataset,
            "frame": "metric",
            "cloud": f"cloud_{cloud}",
            "sensor": "VLP-16",
            "error_model": model,
            "noise_bits": bits,
        }
        for dataset, model, bits in rows
        for cloud in range(clouds)
    )


def recovery_table() -> pd.DataFrame:
    """Recovery of one codec's primitives at three rates, and a rate without primitives."""
    rows = [
        {
            "dataset": "rooms",
            "cloud": "a",
            "codec": "primitives",
            "rate": f"r{rate}",
            "kind": kind,
            "bpp": 0.01 * 4**rate,
            "precision": share,
            "recall": share - 0.1,
            "label_accuracy": share + 0.1 if kind == "all" else 0.0,
        }
        for rate, share in enumerate((0.3, 0.5, 0.6, np.nan), 1)
        for kind in ("all", "plane")
    ]
    return pd.DataFrame(rows)


def clouds_table(clouds: int = 40) -> pd.DataFrame:
    """Point counts with another spread in each data set."""
    rng = generator(7, "counts")
    spreads = {
        "capod": (500_000, 0),
        "s3dis_raw": (790_000, 380_000),
        "s3dis_clean": (1_190_000, 200_000),
        "s3dis_noisy": (1_040_000, 170_000),
    }
    rows = [
        {"dataset": dataset, "cloud": f"cloud_{i}", "points": max(80_000, int(rng.normal(*spread)))}
        for dataset, spread in spreads.items()
        for i in range(clouds)
    ]
    table = pd.DataFrame(rows)
    return table.assign(elongation=np.linspace(0.1, 0.9, len(table)))


def thesis_medians_table() -> pd.DataFrame:
    """The thesis's medians, and a run's that are twice as high."""
    rows = [
        {
            "dataset": dataset,
            "codec": codec,
            "rate": f"r{number}",
            "quantity": quantity,
            "thesis": factor * cd,
            "here": 2 * factor * cd,
        }
        for (dataset, codec), medians in CD_MEDIANS.items()
        for quantity, factor in (("cd_plane", 1), ("hausdorff_sq_plane", 8))
        for number, cd in enumerate(medians, 1)
    ]
    return pd.DataFrame(rows)


def gpcc_scales_table() -> pd.DataFrame:
    """G-PCC at eighths of the grid, as run with three times the error and 1.1 the bits at 1."""
    rows = []
    for dataset in DATASETS:
        for codec, error, bits in (("gpcc", 1.0, 1.0), ("gpcc_arena", 3.0, 1.1)):
            for eighths in range(1, 9):
                scale = eighths / 8
                ratios = {f"bits_{share}": bits for share in ("q25", "median", "q75")}
                ratios |= {f"distortion_{share}": error for share in ("q25", "median", "q75")}
                rows.append(
                    {
                        "dataset": dataset,
                        "codec": codec,
                        "role": "gpcc" if codec == "gpcc" else "gpcc_as_run",
                        "scale": scale,
                        "dyadic": eighths in (1, 2, 4, 8),
                        "clouds": 3,
                        "bpp": 2 * bits * scale,
                        "cd_point": 0.25 * error / scale**2,
                        **ratios,
                    }
                )
    return pd.DataFrame(rows)


def room_cloud(points: int = 60_000, noise_m: float = 0.0) -> PointCloud:
    """A 6 x 4 x 2.7 m box room with a table in it, scaled as for the codecs."""
    rng = generator(7, "room")
    size, scale = np.array([6.0, 4.0, 2.7]), 1023 / 6
    walls = rng.uniform(0, size, (points, 3))
    side = rng.integers(0, 6, points)
    walls[np.arange(points), side // 2] = (side % 2) * size[side // 2]
    table = rng.uniform([2, 1.5, 0.72], [4, 2.5, 0.75], (points // 5, 3))
    metres = np.vstack([walls, table])
    metres += noise_m * rng.normal(size=metres.shape)
    return PointCloud(metres * scale, about={"scale": scale, "offset": [0.0, 0.0, 0.0]})
