"""Readers and writers for files of point clouds, meshes and poses in many formats.

If a file is damaged, or is not what its name says, its reader raises `pointkit.errors.InputError`
with a message of one line that begins with the file's name. Reading a file never runs code in it,
opens no other files than those that belong to it, and takes limited memory for its size.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from cloud_files.clouds import read_cloud as read_cloud
    from cloud_files.clouds import write_cloud as write_cloud
    from cloud_files.evd import write_evd as write_evd
    from cloud_files.float32_frames import write_float32_frame as write_float32_frame
    from cloud_files.las import write_las as write_las
    from cloud_files.las_rewriting import rewrite_las as rewrite_las
    from cloud_files.meshes import read_mesh as read_mesh
    from cloud_files.meshes import read_mesh_report as read_mesh_report
    from cloud_files.meshes import write_mesh as write_mesh
    from cloud_files.pcd import write_pcd as write_pcd
    from cloud_files.ply import write_ply as write_ply
    from cloud_files.poses import read_lidar_poses as read_lidar_poses
    from cloud_files.poses import read_poses as read_poses
    from cloud_files.poses import tum_bytes as tum_bytes
    from cloud_files.text import write_csv as write_csv

__getattr__, __dir__, __all__ = lazy(
    __name__,
    clouds=("read_cloud", "write_cloud"),
    evd=("write_evd",),
    float32_frames=("write_float32_frame",),
    las=("write_las",),
    las_rewriting=("rewrite_las",),
    meshes=("read_mesh", "read_mesh_report", "write_mesh"),
    pcd=("write_pcd",),
    ply=("write_ply",),
    poses=("read_lidar_poses", "read_poses", "tum_bytes"),
    text=("write_csv",),
)
