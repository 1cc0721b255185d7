"""Shared foundations of the point-cloud packages: clouds, meshes, sensors, files and compilation.

The names here are those that are used most. `pointkit.geometry` has searches, planes and Morton
order, `pointkit.lidar` has the returns of spinning sensors, `pointkit.coding` has entropy coders,
and `pointkit.files` writes files either whole or not at all. Only `pointkit.compiling` uses Numba.
Invalid input and damaged streams raise `InputError`.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from pointkit.compiling import compiled as compiled
    from pointkit.errors import InputError as InputError
    from pointkit.geometry.cloud import PointCloud as PointCloud
    from pointkit.geometry.mesh import Mesh as Mesh
    from pointkit.lidar.returns import Beams as Beams
    from pointkit.lidar.returns import Returns as Returns
    from pointkit.lidar.sensor import Sensor as Sensor
    from pointkit.lidar.sensors import load_sensor as load_sensor
    from pointkit.lidar.turns import Layout as Layout
    from pointkit.lidar.turns import Turn as Turn
    from pointkit.registry import Registry as Registry

__getattr__, __dir__, __all__ = lazy(
    __name__,
    compiling=("compiled",),
    errors=("InputError",),
    registry=("Registry",),
    **{
        "geometry.cloud": ("PointCloud",),
        "geometry.mesh": ("Mesh",),
        "lidar.returns": ("Beams", "Returns"),
        "lidar.sensor": ("Sensor",),
        "lidar.sensors": ("load_sensor",),
        "lidar.turns": ("Layout", "Turn"),
    },
)
