"""Sensors that puckbench knows: YAML files in this folder, which cite their sources."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from puckbench.core.errors import InputError, among, naming
from puckbench.core.models import parsed
from puckbench.core.yaml_files import read_yaml
from puckbench.lidar.sensor import Sensor
from puckbench.lidar.unit_calibration import calibration_of_ros, read_calibration

_SENSORS = Path(__file__).parent
_CALIBRATED = "hdl64e_s3"
"""Sensor whose individual units have calibration files."""


def sensor_names() -> list[str]:
    return sorted(path.stem for path in _SENSORS.glob("*.yaml"))


def load_sensor(name_or_path: str | Path) -> Sensor:
    """Load a shipped sensor by name, or a sensor from a file.

    The file describes a sensor (YAML), or is the calibration of an HDL-64E (db.xml, or YAML of
    ROS's velodyne_pointcloud).
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
