"""What packages for point clouds share: clouds and meshes, the returns of sensors, compiled loops.

The names here are the most used ones. `pointkit.coding` has entropy coders, `pointkit.geometry`
searches, planes and Morton order, `pointkit.files` files that are written whole.
`pointkit.compiling` is the one place that uses Numba. Invalid input and damaged streams raise
`InputError`.
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
