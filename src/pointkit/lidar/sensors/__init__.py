"""Known sensors, each described by a YAML file in this folder, which cites its sources."""

from pointkit.lidar.sensor import load_sensor, sensor_names

__all__ = ["load_sensor", "sensor_names"]
