from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from cloud_files.clouds import write_cloud
from cloud_files.meshes import read_mesh
from pointkit.geometry.mesh import Mesh
from pointkit.models import Model
from pointkit.seeding import generator
from puckbench.core.code import MESH_FILES
from puckbench.geometry.sampling import sample_surface
from puckbench.steps.step import STEPS, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (*MESH_FILES, "puckbench.geometry.sampling")


class SamplingSettings(Model):
    """Settings of the sampling of points on a mesh."""

    points: int = Field(500_000, ge=1, description="Number of sampled points (`make: sample`).")


@STEPS.register("sample")
class Sample(SamplingSettings, Step):
    """Sample points on a mesh, uniformly by area (thesis section 6.1.1).

    `seed` is the seed of the random positions.
    """

    seed: int = Field(0, ge=0)

    @classmethod
    def of_plan(cls, flow: Workflow, /, dataset: str, cloud: str) -> PlannedStep:
        data, files = flow.plan.datasets[dataset], flow.files
        _, seed = data.source_of(cloud)
        inputs = files.scene_and_about(dataset, cloud)
        step = cls(points=data.settings.points, seed=seed)
        return planned(step, inputs, also=data.scene_set, memory_mb=files.memory_mb(dataset))

    def run(self, mesh: Path, cloud: Path) -> dict[str, Any]:
        """Sample the file `mesh`, write the points to `cloud`, and return facts about them."""
        return self.write(read_mesh(mesh), mesh, cloud)

    def write(self, surface: Mesh, mesh: Path, cloud: Path) -> dict[str, Any]:
        """Sample the mesh `surface`, in m, of the file `mesh`, as `run` does."""
        sampled = sample_surface(surface, self.points, generator(self.seed, "sample", mesh.stem))
        about = {"source": mesh.name, "seed": self.seed, "kind": "sample"}
        write_cloud(cloud, replace(sampled, about=about))
        return {**about, "points": len(sampled)}
