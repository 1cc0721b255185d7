from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pointkit.lidar.sensors import load_sensor
from puckbench.tables.registry import SENSOR, STUDY, TABLES
from virtual_lidar.errors import open_error_model

if TYPE_CHECKING:
    import pandas as pd

CODE = (
    "pointkit.lidar.sensors",
    "jenco2022.*",
    "virtual_lidar.residual_table",
    "virtual_lidar.sweep",
)

_table = partial(TABLES.register, category=SENSOR, needs=(STUDY, "thesis"))
_MISSING_LASER = 13


@_table("table_4_1", title="The VLP-16 (thesis table 4.1)", number="4.1")
def table_4_1() -> pd.DataFrame:
    """Specifications of the VLP-16 in the sensor's file, beside those of thesis table 4.1."""
    import pandas as pd

    sensor = load_sensor("vlp16")
    high, low = max(sensor.laser_elevation_deg), min(sensor.laser_elevation_deg)
    across, along = sensor.divergence_horizontal_deg, sensor.divergence_vertical_deg
    rounded = "3.0 mrad is 0.172\u00b0; the degrees are used, as in the thesis's code"
    mixed = "1.5 mrad is 0.086\u00b0; section 5.4 once says 0.08\u00b0"
    vertical = f"{high - low:g}\u00b0 ({high:+g}\u00b0 to {low:+g}\u00b0)"
    reach = f"{sensor.min_range_m:g} to {sensor.max_range_m:g} m"
    nearest = "the thesis's simulator has no least range; a real sensor returns nothing below 0.5 m"
    accuracy = f"\u00b1{100 * (sensor.accuracy_m or 0):g} cm"
    rows = [
        ("Wavelength", "903 nm", f"{sensor.wavelength_nm:g} nm", ""),
        ("Pulse length", "6 ns", f"{sensor.pulse_ns:g} ns", "nothing depends on it"),
        ("Field of view (vertical)", "30\u00b0 (+15\u00b0 to -15\u00b0)", vertical, ""),
        ("Field of view (horizontal)", "360\u00b0", "360\u00b0", ""),
        ("Beam divergence (horizontal)", "3.0 mrad (0.18\u00b0)", _beam(across), rounded),
        ("Beam divergence (vertical)", "1.5 mrad (0.09\u00b0)", _beam(along), mixed),
        ("Range", "1 to 100 m", reach, nearest),
        ("Typical accuracy", "3 cm", accuracy, "either way; the error models' noise is narrower"),
    ]
    return pd.DataFrame(rows, columns=["quantity", "thesis", "here", "note"])


_LASERS = {"elevation_deg": "Elevation", "vertical_correction_mm": "Vertical correction"}


@_table(
    "table_4_2",
    title="Lasers of the VLP-16 (thesis table 4.2)",
    number="4.2",
    columns=_LASERS,
)
def table_4_2() -> pd.DataFrame:
    """Elevation and vertical correction of each laser in the sensor's file.

    Thesis table 4.2 leaves out laser 13. The correction applies to captures only.
    """
    import pandas as pd

    sensor = load_sensor("vlp16")
    lasers = np.arange(sensor.lasers)
    missing = "not in the thesis's table; from the manual"
    return pd.DataFrame(
        {
            "laser_id": lasers,
            "elevation_deg": sensor.laser_elevation_deg,
            "vertical_correction_mm": sensor.vertical_correction_mm,
            "note": np.where(lasers == _MISSING_LASER, missing, ""),
        }
    )


_MODELS = ("vlp16", "vlp16_table51")
_TITLE_5_1 = "Parameters of the virtual VLP-16 (thesis table 5.1)"


@_table(
    "table_5_1",
    title=_TITLE_5_1,
    number="5.1",
    error_models=_MODELS,
    columns={"as_printed": "As printed"},
)
def table_5_1() -> pd.DataFrame:
    """Parameters of the virtual VLP-16 beside those of thesis table 5.1.

    The column ``here`` has parameters of the error model ``vlp16``, and ``as_printed`` has those of
    ``vlp16_table51``.
    """
    import pandas as pd

    sensor = load_sensor("vlp16")
    models = [open_error_model(name).described() for name in _MODELS]
    receiver = open_error_model("vlp16", {"receiver": {}}).described()["receiver"]
    turn, reach = f"{sensor.rotation_hz:g} Hz", f"{sensor.max_range_m:g} m"
    attenuated = f"{receiver['attenuation_from_m']:g} m"
    bias = "section 5.4 states what stands here; Figure 5.18 fits 0.02 m"
    ray = "section 5.4 states what stands here"
    receivers = "of a receiver, which an error model has where it is given one"
    rows = [
        ("Rotation speed", "5 Hz", turn, turn, ""),
        ("Max distance", "100 m", reach, reach, ""),
        ("Distance bias mean", "0.0 m", "0 m", "0 m", "not a parameter here"),
        ("Distance bias sigma", "0.078 m", *_metres(models, "bias_sigma_m"), bias),
        ("Per-ray noise mean", "0.0 m", *_metres(models, "ray_mean_m"), ""),
        ("Per-ray noise sigma", "0.014 m", *_metres(models, "ray_sigma_m"), ray),
        ("Reflectivity distance", "50 m", attenuated, attenuated, receivers),
    ]
    return pd.DataFrame(rows, columns=["quantity", "thesis", "here", "as_printed", "note"])


def _beam(width_deg: float) -> str:
    return f"{np.radians(width_deg) * 1000:.2f} mrad ({width_deg:g}\u00b0)"


def _metres(models: Sequence[Mapping[str, Any]], name: str) -> list[str]:
    return [f"{model[name]:g} m" for model in models]
