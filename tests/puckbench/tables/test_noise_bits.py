"""The table of what noise costs, on rows made by hand."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pointkit.errors import InputError
from puckbench.tables.noise_bits import noise_bits

MODELS = {"none": 0.0, "vlp16": 4.0}
CURVES = {
    # Bits and error (mm) by rate. Exact; on a grid of 1 mm, whose error is 0.5 and larger along
    # walls; and neither, though its largest bits are the most of all.
    "puck": {"10mm": (2.0, 2.5), "2mm": (3.0, 0.0)},
    "gpcc": {"10mm": (2.0, 5.0), "2mm": (5.0, 0.9), "1mm": (8.0, 0.52)},
    "reno": {"8mm": (5.0, 4.0), "4mm": (30.0, 2.0)},
}


def _clouds() -> pd.DataFrame:
    """Rooms under two models; a street under one, and a recording."""
    rows = [
        {"dataset": f"rooms_{model}", "cloud": cloud, "error_model": model, "noise_bits": bits}
        for model, bits in MODELS.items()
        for cloud in ("a", "b")
    ]
    rows += [{"dataset": "street", "cloud": "c", "error_model": "vlp16", "noise_bits": 4.5}]
    rows += [{"dataset": "tape", "cloud": "a", "error_model": None, "noise_bits": np.nan}]
    return pd.DataFrame(rows).assign(frame="metric", sensor="VLP-16", turns=1, firings=1800)


def _metrics() -> pd.DataFrame:
    """Bits grow with the noise: one and a half bits for each of it in the second room."""
    rows = []
    for _, cloud in _clouds().iterrows():
        noise = 0.0 if np.isnan(cloud["noise_bits"]) else cloud["noise_bits"]
        more = noise * (1.5 if cloud["cloud"] == "b" else 1.0)
        rows += [
            {
                "dataset": cloud["dataset"], "frame": "metric", "cloud": cloud["cloud"],
                "codec": codec, "rate": rate, "bpp": bits + more, "d1_rms_m": error_mm / 1000,
            }
            for codec, curve in CURVES.items()
            for rate, (bits, error_mm) in curve.items()
        ]  # fmt: skip
    return pd.DataFrame(rows)


def test_exact_and_1_mm_are_compared_and_no_coarser_rate() -> None:
    table = noise_bits(_metrics(), _clouds()).set_index(["error_model", "codec"])
    assert table.loc[("none", "puck"), "grid_1_mm"] == 3
    assert table.loc[("none", "gpcc"), "grid_1_mm"] == 8
    assert np.isnan(table.loc[("none", "reno"), "grid_1_mm"])
    # 4 and 6 bits more for the noise of 4 bits, in the mean of two rooms.
    assert table.loc[("vlp16", "puck"), "added_grid_1_mm"] == 5
    assert table.loc[("none", "puck"), "added_grid_1_mm"] == 0
    # Of 7 and 9 bits the quietest model saves 4 and 6.
    saved = 100 * (4 / 7 + 6 / 9) / 2
    assert table.loc[("vlp16", "puck"), "saved_grid_1_mm_percent"] == pytest.approx(saved)
    assert table.filter(regex="_(low|high)$").isna().all(axis=None)
    assert set(table["noise_bits"]) == {0, 4}
    assert set(table["scenes"]) == {0, 2}  # 0: no rate reaches either error


def test_bits_at_an_equal_error_stand_beside_them() -> None:
    table = noise_bits(_metrics(), _clouds()).set_index(["error_model", "codec"])
    assert table.loc[("none", "gpcc"), "at_5_mm"] == pytest.approx(2)
    assert table.loc[("vlp16", "gpcc"), "added_at_5_mm"] == pytest.approx(5)
    assert np.isnan(table.loc[("none", "reno"), "at_5_mm"])  # 4 mm is its coarsest


def test_seeds_of_six_scenes_count_once_and_have_an_interval() -> None:
    """Two seeds each; the noise costs 1 to 6 bits."""
    extra = {f"s{n}": float(n) for n in range(1, 7)}
    clouds, metrics = [], []
    for model, share in (("none", 0), ("vlp16", 1)):
        for scene, bits in extra.items():
            for seed in (-0.5, 0.5):
                names = {"dataset": f"rooms_{model}", "cloud": f"{scene}{seed}", "frame": "metric"}
                clouds.append(
                    {**names, "scene": scene, "error_model": model, "noise_bits": 4.0 * share}
                )
                bpp = 2 + share * (bits + seed)
                metrics.append({**names, "codec": "puck", "rate": "2mm", "bpp": bpp, "d1_rms_m": 0})
    rays = {"sensor": "VLP-16", "turns": 1, "firings": 1800}
    table = noise_bits(pd.DataFrame(metrics), pd.DataFrame(clouds).assign(**rays))
    row = table.set_index("error_model").loc["vlp16"]
    assert (row["scenes"], row["added_grid_1_mm"]) == (6, 3.5)
    expected = stats.t.interval(0.95, 5, 3.5, stats.sem(range(1, 7)))
    ends = row[["added_grid_1_mm_low", "added_grid_1_mm_high"]].tolist()
    assert ends == pytest.approx(list(expected))
    saved = np.mean([100 * n / (n + 2) for n in range(1, 7)])
    assert row["saved_grid_1_mm_percent"] == pytest.approx(saved)


def test_rays_of_one_model_and_recordings_have_no_part_in_it() -> None:
    table = noise_bits(_metrics(), _clouds())
    assert set(table["dataset"]) == {"rooms_none", "rooms_vlp16"}
    both = pd.concat([_clouds(), _clouds().query("dataset == 'street'").assign(
        dataset="street_none", error_model="none", noise_bits=0.0
    )])  # fmt: skip
    drives = both.assign(turns=np.where(both["dataset"] == "street", 10, 1))
    assert set(noise_bits(_metrics(), drives)["dataset"]) == {"rooms_none", "rooms_vlp16"}
    more = _metrics().query("dataset == 'street'").assign(dataset="street_none")
    table = noise_bits(pd.concat([_metrics(), more]), both)
    assert {"street", "street_none"} < set(table["dataset"])


def test_rows_are_ordered_by_models_noise_and_bits() -> None:
    """Rays of more models first, then the least noise, then the fewest bits of whole codecs."""
    rooms, street = (
        _clouds().query(f"dataset == '{dataset}'") for dataset in ("rooms_none", "street")
    )
    clouds = pd.concat([
        _clouds(),
        street.assign(dataset="a_street", error_model="none", noise_bits=0.0),
        rooms.assign(dataset="more", error_model="vlp16_measured", noise_bits=3.0),
        rooms.assign(dataset="again"),
    ])  # fmt: skip
    metrics = _metrics().replace({"d1_rms_m": {0.004: 0.009}})  # of reno
    alike = {"a_street": "street", "more": "rooms_none", "again": "rooms_none"}
    parts = [metrics[metrics["dataset"] == of].assign(dataset=name) for name, of in alike.items()]
    metrics = pd.concat([metrics, *parts])
    reno = metrics[metrics["codec"] == "reno"]
    metrics = pd.concat([metrics, reno.assign(codec="a_reno", bpp=reno["bpp"] + 1)])
    table = noise_bits(metrics, clouds)
    assert list(table["dataset"].unique()) == [
        "again", "rooms_none", "more", "rooms_vlp16", "a_street", "street",
    ]  # fmt: skip
    first = table[table["dataset"] == "again"]
    assert list(first["codec"]) == ["puck", "gpcc", "reno", "a_reno"]


def test_without_several_models_it_is_an_input_error() -> None:
    with pytest.raises(InputError, match="same rays under several error models"):
        noise_bits(_metrics(), _clouds().query("error_model == 'none'"))
    with pytest.raises(InputError, match="no cloud has an entropy"):
        noise_bits(_metrics(), _clouds().drop(columns="noise_bits"))
