"""Descriptions of rotating LiDARs, read from YAML files that cite their sources."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Self

from pydantic import NonNegativeFloat, PositiveFloat, model_validator

from pointkit.errors import InputError, among, naming
from pointkit.lidar.unit_calibration import calibration_of_ros, read_calibration
from pointkit.models import Model, parsed
from pointkit.yaml_files import read_yaml

_SENSORS = Path(__file__).parent / "sensors"
# Data sheets round the azimuth step (0.1 for 0.0995 degrees of the VLP-16, 0.09 for 0.0864).
_STEP_TOLERANCE = 0.05
_OF_LASERS = (
    "vertical_correction_mm",
    "laser_azimuth_deg",
    "horizontal_correction_mm",
    "distance_correction_mm",
    "distance_correction_x_mm",
    "distance_correction_y_mm",
    "firing_offsets_us",
)
_CALIBRATED = "hdl64e_s3"
"""Sensor whose individual units have calibration files."""


class Sensor(Model):
    """Description of a rotating LiDAR (thesis, Tables 4.1 and 4.2).

    Each tuple has one item for each laser.
    """

    name: str
    laser_elevation_deg: tuple[float, ...]
    rotation_hz: PositiveFloat
    """The rotation rate and the azimuth step are defaults of sweeps."""
    azimuth_step_deg: PositiveFloat
    max_range_m: PositiveFloat
    min_range_m: NonNegativeFloat = 0.0
    divergence_horizontal_deg: NonNegativeFloat = 0.0
    divergence_vertical_deg: NonNegativeFloat = 0.0
    """Both divergences are full angular widths of the beam."""
    vertical_correction_mm: tuple[float, ...] | None = None
    laser_azimuth_deg: tuple[float, ...] | None = None
    """Azimuths of lasers relative to the sensor's azimuth. Virtual scans ignore azimuths and
    corrections of lasers."""
    horizontal_correction_mm: tuple[float, ...] | None = None
    """Distances of lasers from the axis, positive against the direction of rotation."""
    distance_correction_mm: tuple[float, ...] | None = None
    """Additions to ranges of returns at 25.04 m or beyond."""
    distance_correction_x_mm: tuple[float, ...] | None = None
    """Additions to ranges of returns 2.4 m to either side; linear up to 25.04 m (HDL-64E
    manual)."""
    distance_correction_y_mm: tuple[float, ...] | None = None
    """Additions to ranges of returns 1.93 m ahead or behind; linear up to 25.04 m."""
    range_quantum_mm: PositiveFloat | None = None
    firing_sequence_us: PositiveFloat | None = None
    firing_interval_us: PositiveFloat | None = None
    """Time between successive lasers of a firing sequence."""
    firing_offsets_us: tuple[float, ...] | None = None
    """Firing time of each laser in the sequence; replaces `firing_interval_us`."""
    wavelength_nm: PositiveFloat | None = None
    pulse_ns: PositiveFloat | None = None
    accuracy_m: PositiveFloat | None = None
    """Typical accuracy (plus or minus) stated by the manufacturer; no error model uses it."""
    manufacturer: str | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.laser_elevation_deg:
            raise InputError("laser_elevation_deg is empty")
        if len(set(self.laser_elevation_deg)) < self.lasers:
            raise InputError("laser_elevation_deg has the same angle twice")
        if any(abs(elevation) > 90 for elevation in self.laser_elevation_deg):
            raise InputError("laser_elevation_deg has an angle beyond 90 degrees")
        for name in _OF_LASERS:
            values = getattr(self, name)
            if values is not None and len(values) != self.lasers:
                raise InputError(f"{len(values)} {name} for {self.lasers} lasers")
        if self.min_range_m >= self.max_range_m:
            raise InputError(
                f"min_range_m {self.min_range_m} is not below max_range_m {self.max_range_m}"
            )
        self._check_firing()
        return self

    def __str__(self) -> str:
        return repr(self)

    def _check_firing(self) -> None:
        sequence, offsets = self.firing_sequence_us, self._firing_offsets()
        if sequence is None:
            if offsets is not None:
                raise InputError("firing_interval_us and firing_offsets_us need firing_sequence_us")
            return
        if offsets is not None and not 0 <= min(offsets) <= max(offsets) < sequence:
            raise InputError(
                f"{self.lasers} lasers that fire at {min(offsets):g} to {max(offsets):g} us do not"
                f" fit in the firing_sequence_us of {sequence}"
            )
        turned = 360.0 * self.rotation_hz * sequence * 1e-6
        if abs(turned / self.azimuth_step_deg - 1) > _STEP_TOLERANCE:
            raise InputError(
                f"azimuth_step_deg is {self.azimuth_step_deg}, but the sensor turns {turned:.4g}"
                f" degrees in a firing sequence of {sequence} us at {self.rotation_hz} Hz"
            )

    def _firing_offsets(self) -> tuple[float, ...] | None:
        interval, offsets = self.firing_interval_us, self.firing_offsets_us
        if offsets is None:
            return None if interval is None else tuple(k * interval for k in range(self.lasers))
        if interval is not None:
            raise InputError("firing_interval_us and firing_offsets_us exclude each other")
        return offsets

    @property
    def firing_times_us(self) -> tuple[float, ...]:
        """Firing time of each laser after the start of a firing sequence, microseconds.

        Raises InputError if the times are unknown.
        """
        offsets = self._firing_offsets()
        if offsets is None:
            raise InputError(f"sensor {self.name} does not state when its lasers fire")
        return offsets

    @property
    def lasers(self) -> int:
        """Number of lasers."""
        return len(self.laser_elevation_deg)


def sensor_names() -> list[str]:
    """Return the names of the sensors that pointkit describes, which `load_sensor` accepts."""
    return sorted(path.stem for path in _SENSORS.glob("*.yaml"))


def load_sensor(name_or_path: str | Path) -> Sensor:
    """Load the description of a sensor, by its name or from a file.

    Parameters
    ----------
    name_or_path
        Name of a sensor that pointkit describes (such as ``vlp16``; see `sensor_names`), or a file.
        The file is a description (YAML) or the calibration of an HDL-64E (VeloView's db.xml, or the
        YAML file of ROS's velodyne_pointcloud).

    Returns
    -------
    Sensor
        The checked description.

    Raises
    ------
    InputError
        There is no such sensor or file, or the description is not valid.
    """
    path = Path(name_or_path)
    if path.suffix not in {".yaml", ".yml", ".xml"}:
        path = _SENSORS / f"{name_or_path}.yaml"
        name = str(name_or_path)
        if name not in sensor_names():
            choices = among(name, [*sensor_names(), "or a .yaml file"])
            raise InputError(f"unknown sensor {name!r}{choices}")
    if path.suffix == ".xml":
        return load_sensor(_CALIBRATED).replaced(**read_calibration(path))
    options = read_yaml(path)
    if not isinstance(options, Mapping):
        raise InputError(f"{path}: expected names and values of a sensor")
    if "lasers" in options:
        with naming(path):
            return load_sensor(_CALIBRATED).replaced(**calibration_of_ros(options))
    return parsed(Sensor, options, str(path))
