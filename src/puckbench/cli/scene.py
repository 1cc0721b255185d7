"""`puckbench scene`: one scene of a scene set, as a labelled mesh or a cloud in metres, z up."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from puckbench.cli.types import json_object, whole
from puckbench.datasets.registry import open_scene_set
from puckbench.datasets.scene import Scene
from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import write_cloud
from puckbench.io.meshes import write_mesh


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("loader", help="loader of the scene set (see `puckbench datasets`)")
    parser.add_argument("name", help="name of the scene")
    parser.add_argument("out", type=Path, help="PLY file to write; its description goes beside it")
    parser.add_argument("--options", type=json_object, default={}, help="options of the loader")
    parser.add_argument("--seed", type=whole(0), default=0, help="of a loader that has one")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Write the scene and its description."""
    scene = open_scene_set(options.loader, options.options, options.seed).load(options.name)
    about = description(scene)
    if scene.mesh is not None:
        write_mesh(options.out, scene.mesh, about)
        return {**about, "triangles": len(scene.mesh.triangles)}
    cloud = scene.cloud
    if cloud is None:
        raise ValueError(f"scene {scene.name} has neither a mesh nor a cloud")
    write_cloud(
        options.out, PointCloud(cloud.xyz, cloud.normals, cloud.colours, cloud.labels, about)
    )
    return {**about, "points": len(cloud)}


def description(scene: Scene) -> dict[str, Any]:
    """What stands beside the scene's file: name, group, sensor position, room's box, credits."""
    box = scene.mesh.bounds() if scene.box is None and scene.mesh else scene.box
    return {
        **scene.about,
        "name": scene.name,
        "group": scene.group,
        "origin": None if scene.origin is None else list(scene.origin),
        "box": None if box is None else box.tolist(),
    }
