"""Rate and distortion of codecs on scanned rooms: to the scan, and to the true surface.

    python -m benchmarks.ablations.primitives_rate_distortion --captured FOLDER [--rooms NAME ...]
        [--furniture FOLDER] [--codecs primitives draco ...] [--step 0.4]
        [--errors vlp16_divergence] [--cache FOLDER]

Rooms are captured ones (of FOLDER) and generated ones, by name; `office_1_furnished` is `office_1`
with Sweet Home 3D's furniture (`--furniture`). Each is swept by a VLP-16 (a step of 0.4 deg makes
288,000 rays, the sensor's own 0.1 deg 1,152,000), cropped and scaled to 1023.
One line a codec and rate: bpp, CD(plane) to the scan, CD(plane) and CD(point) to the truth,
seconds to encode and decode; first the scan's own error to the truth. `--cache` keeps the clouds.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from puckbench.codecs.registry import codecs, open_codec
from puckbench.core.seeding import generator
from puckbench.datasets.captured_rooms import CapturedRooms
from puckbench.datasets.embedded_rooms import EmbeddedRooms
from puckbench.datasets.scene import Scene
from puckbench.geometry.closest import mesh_in_frame
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.mesh import Mesh
from puckbench.jobs.preparation import Returns, prepare
from puckbench.lidar.errors import open_error_model
from puckbench.lidar.placement import free_origin
from puckbench.lidar.scan import scan
from puckbench.lidar.sensor import load_sensor
from puckbench.lidar.sweep import open_sweep
from puckbench.metrics.geometry import distortion
from puckbench.metrics.truth import truth_distortion

ROOMS = ("living_room", "meeting_room", "office_1", "storage_1")
FURNISHED = "_furnished"
"""What a generated room's name ends in when catalogues' models take the place of its furniture."""


@dataclass(frozen=True, eq=False)
class Room:
    """A scanned room: the scan, the true points of its rays, the true surface; one frame."""

    scan: PointCloud
    visible: PointCloud
    mesh: Mesh


def scene_of(name: str, captured: Path, furniture: Path | None = None) -> Scene:
    """A captured room if the folder has it, else a generated one, with real furniture if asked."""
    if (captured / f"{name}.json").exists():
        return CapturedRooms(path=str(captured)).load(name)
    if name.endswith(FURNISHED):
        return EmbeddedRooms(furniture=str(furniture)).load(name.removesuffix(FURNISHED))
    return EmbeddedRooms().load(name)


def scanned(scene: Scene, errors: str, step: float) -> Returns:
    """The scene's noisy and true points in metres."""
    assert scene.mesh is not None
    origin = scene.origin or free_origin(scene.mesh)
    table = scan(
        scene.mesh,
        load_sensor("vlp16"),
        open_sweep({"azimuth_step_deg": step}),
        open_error_model(errors),
        origin,
        generator(2022, "scan", scene.name),
    )
    clean = PointCloud(table.xyz, table.normals, labels=table.primitive_id)
    found = Returns(PointCloud(table.xyz_noisy, labels=table.primitive_id), clean)
    return found if scene.box is None else found.cropped(scene.box)


def room(name: str, options: argparse.Namespace) -> Room:
    """The room as the benchmark prepares it, from the cache if it is there."""
    scene = scene_of(name, options.captured, options.furniture)
    assert scene.mesh is not None
    kept = options.cache / f"{name}_{options.errors}_{options.step:g}.npz"
    if not kept.exists():
        returns = scanned(scene, options.errors, options.step)
        cloud = prepare(returns.cloud)
        true = returns.truth_in_frame_of(cloud)
        options.cache.mkdir(parents=True, exist_ok=True)
        frame = {"scale": cloud.about["scale"], "offset": cloud.about["offset"]}
        values = {"xyz": cloud.xyz, "normals": cloud.normals, "labels": cloud.labels, **frame}
        np.savez(kept, true_xyz=true.xyz, true_normals=true.normals, **values)
    held = np.load(kept)
    about = {"scale": float(held["scale"]), "offset": held["offset"].tolist()}
    cloud = PointCloud(held["xyz"], held["normals"], labels=held["labels"], about=about)
    visible = PointCloud(held["true_xyz"], held["true_normals"], labels=held["labels"])
    return Room(cloud, visible, mesh_in_frame(scene.mesh, about["scale"], held["offset"]))


def errors(found: Room, decoded: Floats) -> tuple[float, float, float]:
    """CD(plane) to the scan, CD(plane) and CD(point) to the truth."""
    to_truth = truth_distortion(found.visible, found.mesh, decoded)
    to_scan = distortion(found.scan, decoded)["cd_plane"]
    return to_scan, to_truth["truth_cd_plane"], to_truth["truth_cd_point"]


def measure(found: Room, codec_name: str, rates: list[str]) -> None:
    """Print a line for each rate of a codec."""
    codec = open_codec(codec_name)
    codec.load()
    codec.decode(codec.encode(found.scan.xyz[::50], next(iter(codec.rates))))
    for rate in rates or codec.rates:
        start = time.perf_counter()
        stream = codec.encode(found.scan.xyz, rate)
        between = time.perf_counter()
        decoded = codec.decode(stream)
        end = time.perf_counter()
        bpp = 8 * len(stream) / len(found.scan)
        values = " ".join(f"{value:9.3f}" for value in errors(found, decoded))
        times = f"{between - start:6.2f} {end - between:6.2f}"
        print(f"  {codec_name:11} {rate} {bpp:8.4f} {values} {times} {len(decoded):8}", flush=True)


def main() -> None:
    """Print a table for each room."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captured", type=Path, default=Path("data/rooms_quest"))
    parser.add_argument("--furniture", type=Path, default=Path("data/sweethome3d"))
    parser.add_argument("--rooms", nargs="+", default=ROOMS)
    parser.add_argument("--codecs", nargs="+", default=list(codecs()))
    parser.add_argument("--rates", nargs="+", default=[])
    parser.add_argument("--errors", default="vlp16_divergence")
    parser.add_argument("--step", type=float, default=0.4)
    parser.add_argument("--cache", type=Path, default=Path("results/primitives_benchmark"))
    options = parser.parse_args()
    for name in options.rooms:
        found = room(name, options)
        print(f"{name}: {len(found.scan)} points, {1000 / found.scan.about['scale']:.2f} mm a unit")
        values = " ".join(f"{value:9.3f}" for value in errors(found, found.scan.xyz))
        print(f"  {'the scan':14} {'':8} {values}")
        for codec in options.codecs:
            measure(found, codec, options.rates)


if __name__ == "__main__":
    main()
