"""G-PCC per scale, and the thesis's medians beside a run's."""

import numpy as np
import pandas as pd
import pytest

from jenco2022.tables.claims import thesis_medians
from jenco2022.tables.gpcc_scales import gpcc_scales
from pointkit.errors import InputError

SCALES = {"gpcc": {"r1": 0.5, "r2": 0.75}, "arena": {"r1": 0.5, "r2": 0.75}}
ROLES = {"gpcc": "gpcc", "gpcc_as_run": "arena"}


def _metrics() -> pd.DataFrame:
    rows = []
    for number, cloud in enumerate("abc"):
        for codec, bits, error in (("gpcc", 1.0, 1.0), ("arena", 1.5 + number / 10, 3.0)):
            for rate in ("r1", "r2"):
                bpp, cd = (1 + number) * bits, 0.25 * error * (1 + number)
                values = {"bpp": bpp, "cd_point": cd, "cd_plane": cd / 3, "d1_psnr": 60.0}
                names = {"dataset": "rooms", "cloud": cloud, "codec": codec, "rate": rate}
                rows.append({**names, **values})
    return pd.DataFrame(rows)


def test_ratios_are_taken_cloud_by_cloud_at_one_scale() -> None:
    table = gpcc_scales(_metrics(), codecs=ROLES, scales=SCALES).set_index(["codec", "scale"])
    assert table.loc[("arena", 0.75), "bits_median"] == pytest.approx(1.6)
    assert table.loc[("arena", 0.5), "bits_q25"] == pytest.approx(1.55)
    assert table.loc[("arena", 0.5), "distortion_median"] == pytest.approx(3.0)
    assert (table.loc["gpcc", "bits_median"] == 1).all()
    assert table["clouds"].eq(3).all()
    assert table["dyadic"].to_dict()[("gpcc", 0.5)]
    assert not table["dyadic"].to_dict()[("gpcc", 0.75)]


def test_without_the_reference_there_are_no_ratios() -> None:
    metrics = _metrics()
    alone = gpcc_scales(metrics[metrics["codec"] == "arena"], codecs=ROLES, scales=SCALES)
    assert alone["bits_median"].isna().all()
    assert alone["bpp"].notna().all()
    with pytest.raises(InputError, match="no results of"):
        gpcc_scales(metrics.assign(codec="draco"), codecs=ROLES, scales=SCALES)


def test_the_thesis_s_medians_stand_beside_the_run_s() -> None:
    metrics = _metrics().assign(hausdorff_sq_plane=7.0, dataset="mine")
    table = thesis_medians(metrics, datasets={"mine": "sampled rooms"}, codecs=ROLES)
    rows = table[(table["quantity"] == "cd_plane") & (table["rate"] == "r2")].set_index("codec")
    assert rows["kind"].eq("rooms").all()
    assert rows["thesis"].to_dict() == {"gpcc": 1.4, "arena": 1.4}  # the thesis has one G-PCC
    np.testing.assert_allclose(rows.loc["gpcc", "here"], 0.5 / 3)
