"""Sensors that puckbench knows: YAML files in this folder, which cite their sources.

Code that names a sensor itself, in place of its caller or a configuration, imports from here: the
fingerprint of such code includes these files (`puckbench.planning.fingerprints`).
"""

from pointkit.lidar.sensor import load_sensor, sensor_names

__all__ = ["load_sensor", "sensor_names"]
