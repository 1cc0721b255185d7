"""Clouds that several benchmarks of G-PCC code: a scanned room and a sampled object."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensors import load_sensor
from pointkit.seeding import generator
from puckbench.geometry.sampling import sample_surface
from puckbench.geometry.scaling import cube_scaling
from puckbench.recordings.writing import write_pcap
from virtual_lidar import free_origin, open_error_model, open_sweep, scan
from virtual_lidar.scenes.objects import make_object
from virtual_lidar.scenes.rooms import make_room


def scanned_room(errors: str, azimuth_step_deg: float = 0.1, name: str = "office_1") -> Floats:
    """A room's returns in [0, 1023]; a step of 0.1 degrees is the thesis's 1,152,000 rays."""
    mesh = make_room(name, seed=1)
    sweep = open_sweep({"azimuth_step_deg": azimuth_step_deg})
    model = open_error_model(errors, None)
    random = generator(1, "gpcc benchmark", errors)
    table = scan(mesh, load_sensor("vlp16"), sweep, model, free_origin(mesh), random)
    return cube_scaling(table.xyz_noisy).apply(table.xyz_noisy)


def sampled_object(points: int, name: str = "chair_01") -> Floats:
    """Random points on an object's surface, in [0, 1023]."""
    cloud = sample_surface(make_object(name, seed=1), points, generator(1, "gpcc benchmark"))
    return cube_scaling(cloud.xyz).apply(cloud.xyz)


def grown(points: Floats, bits: int) -> Floats:
    """The same cloud scaled and rounded to a grid of 2^bits cells a side."""
    cells: Floats = np.rint(points * (2**bits - 1) / 1023)
    return cells


def write_recording(file: Path, turns: int) -> Path:
    """A capture of some turns of a virtual VLP-16 at rest in a room, 10 a second."""
    mesh = make_room("office_1", seed=1)
    hertz = {"rotation_hz": 10.0, "frames_per_second": 10.0, "duration_s": turns / 10}
    sweep = open_sweep({"preset": "spin", "azimuth_step_deg": 0.2, **hertz})
    model, random = open_error_model("vlp16", None), generator(1, "benchmark of recordings")
    write_pcap(file, scan(mesh, load_sensor("vlp16"), sweep, model, free_origin(mesh), random))
    return file
