from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import Field, PositiveFloat

from cloud_files.clouds import write_cloud
from pointkit.seeding import generator
from puckbench.core.code import MESH_FILES
from puckbench.geometry.sampling import sample_surface
from puckbench.jobs.registry import JOBS, Job
from puckbench.jobs.surfaces import read_surface

CODE = (*MESH_FILES, "puckbench.geometry.sampling", "puckbench.jobs.surfaces")


@JOBS.register("sample")
class Sample(Job):
    """Sample points on a mesh, uniformly by area (thesis section 6.1.1).

    Parameters
    ----------
    points
        Number of points.
    seed
        Seed of the random positions.
    metres_per_unit
        Factor by which the coordinates of the mesh are multiplied.
    """

    points: int = Field(500_000, ge=1)
    seed: int = Field(0, ge=0)
    metres_per_unit: PositiveFloat = 1.0

    def run(self, mesh: Path, cloud: Path) -> dict[str, Any]:
        """Sample the file `mesh`, write the points to `cloud`, and return facts about them."""
        surface = read_surface(mesh, self.metres_per_unit)
        sampled = sample_surface(surface, self.points, generator(self.seed, "sample", mesh.stem))
        about = {"source": mesh.name, "seed": self.seed, "kind": "sample"}
        write_cloud(cloud, replace(sampled, about=about))
        return {**about, "points": len(sampled)}
