from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from cloud_files.clouds import write_cloud
from cloud_files.descriptions import write_description
from cloud_files.meshes import write_mesh
from pointkit.models import Model
from puckbench.core.code import MESH_FILES
from puckbench.scene_sets.loader_code import loader_modules
from puckbench.scene_sets.registry import open_scene_set
from puckbench.scene_sets.scene import Scene
from puckbench.steps.step import STEPS, PlannedStep, Step, planned

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

CODE = (*MESH_FILES, "puckbench.scene_sets.base")


class LoaderSettings(Model):
    """A loader of scenes with its options."""

    loader: str = Field(
        description="Name of a loader (`puckbench datasets` lists them with their options), or "
        "your own class: `module:Class` or `path/to/file.py:Class`."
    )
    options: dict[str, Any] = Field({}, description="Options of the loader.")


@STEPS.register("scene")
class WriteScene(LoaderSettings, Step):
    """Write a scene of a scene set as a mesh, a cloud or a table of a sensor's returns.

    Parameters
    ----------
    name
        Name of the scene.
    seed
        Seed of generated scenes.
    """

    name: str
    seed: int = 0

    @classmethod
    def of_plan(cls, flow: Workflow, /, scene_set: str, scene: str) -> PlannedStep:
        source = flow.plan.scene_sets[scene_set]
        is_generated = "seed" in type(source.scenes).model_fields
        step = cls(
            loader=source.loader,
            name=scene,
            options=source.options_of(scene),
            seed=source.seed if is_generated else 0,
        )
        files = source.files(scene)
        return planned(
            step,
            {},
            *loader_modules(source.loader, files),
            content={"files": files},
            also=flow.plan.digest_of(files),
            memory_mb=2000,
        )

    def plugins(self) -> Iterable[str | None]:
        return (self.loader,)

    def run(self, scene: Path) -> dict[str, Any]:
        """Write the file `scene` with a description beside it, and return the description."""
        loaded = open_scene_set(self.loader, self.options, self.seed).load(self.name)
        about = description(loaded)
        if loaded.mesh is not None:
            write_mesh(scene, loaded.mesh, about)
            return {**about, "triangles": len(loaded.mesh.triangles)}
        if loaded.returns is not None:
            from pointkit.lidar.returns import write_firings

            write_firings(scene, loaded.returns)
            write_description(scene, "returns", about)
            return {**about, "returns": len(loaded.returns)}
        if loaded.cloud is None:
            raise ValueError(f"scene {loaded.name} holds nothing")
        write_cloud(scene, replace(loaded.cloud, about=about))
        return {**about, "points": len(loaded.cloud)}


def description(scene: Scene) -> dict[str, Any]:
    """Return the description of a scene as JSON values, such as name, group and bounding box."""
    box = scene.mesh.bounds() if scene.box is None and scene.mesh else scene.box
    return {
        **scene.about,
        "name": scene.name,
        "group": scene.group,
        "origin": None if scene.origin is None else list(scene.origin),
        "box": None if box is None else box.tolist(),
    }
