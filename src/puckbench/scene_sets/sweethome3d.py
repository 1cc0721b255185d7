"""Furniture of Sweet Home 3D: 820 models in five catalogues, as packaged by Debian."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cloud_files.meshes.reading import mesh_from_polygons, y_up_to_z_up
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.geometry.mesh import Mesh, SceneObject
from pointkit.yaml_files import read_yaml
from puckbench.scene_sets.base import SceneSet, freeform_labels, look_up, select_names
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene, safe_name, unique_names

CODE = ("cloud_files.meshes.obj",)

INSTALLED = "/usr/share/sweethome3d/furniture"
_INSIDE = ("", "furniture", "usr/share/sweethome3d/furniture")
_PROPERTIES = "PluginFurnitureCatalog.properties"
_read_table = cache(read_yaml)
_ESCAPE = re.compile(r"\\u([0-9A-Fa-f]{4})")


@dataclass(frozen=True)
class CatalogueModel:
    """A furniture model as a catalogue describes it.

    `size` is width, depth and height in m. `rotation` (3, 3) turns the model, with y up, before it
    is scaled.
    """

    name: str
    title: str
    semantic: str
    category: str
    archive: Path
    member: str
    size: tuple[float, float, float]
    rotation: Floats
    creator: str
    licence: str


@LOADERS.register("sweethome3d")
class SweetHome3D(SceneSet):
    """The scenes are furniture models of ``.sh3f`` catalogues, scaled to the sizes given there.

    They are named scopia-chair2 (catalogue and model) and grouped by semantic class. A model stands
    on z = 0, centred at x = y = 0, and faces -y.
    """

    path: str = INSTALLED
    """Folder of the catalogues, or of the unpacked Debian package; by default, the package's
    installation folder."""
    classes: tuple[str, ...] | None = None
    """Semantic classes to keep (chair, table, sofa, bookcase, ...); all models by default."""

    def names(self) -> list[str]:
        return sorted(self._table)

    def files(self, name: str) -> list[Path]:
        return [self.model(name).archive]

    def load(self, name: str) -> Scene:
        model = self.model(name)
        raw, report = _read_model(model)
        mesh, factors = _to_size(raw, model)
        about = {
            "source": f"{model.archive.name}/{model.member}",
            "title": model.title,
            "category": model.category,
            "licence": model.licence,
            "credit": model.creator,
            "rescaled_by": factors,
            **report,
        }
        return Scene(name, model.semantic, mesh=_labelled(mesh, model), about=about)

    def model(self, name: str) -> CatalogueModel:
        """Return what the catalogue says about the model of a scene."""
        return look_up(self._table, name, str(self.path))

    def _catalogues(self) -> list[Path]:
        for inside in _INSIDE:
            paths = sorted((Path(self.path) / inside).glob("*.sh3f"))
            if paths:
                return paths
        expected = "expected Debian's sweethome3d-furniture"
        raise InputError(f"{self.path}: no .sh3f catalogues ({expected})")

    @cached_property
    def _table(self) -> dict[str, CatalogueModel]:
        models = [model for path in self._catalogues() for model in _read_catalogue(path)]
        names = unique_names(model.name for model in models)
        classes = sorted({model.semantic for model in models})
        kept = select_names("classes", self.classes, classes)
        table = zip(names, models, strict=True)
        return {name: model for name, model in table if model.semantic in kept}


def _read_catalogue(path: Path) -> Iterator[CatalogueModel]:
    properties = _read_properties(path)
    licence = " ".join(properties.get("license", "").split())
    items: dict[str, dict[str, str]] = {}
    for key, value in properties.items():
        field, mark, number = key.partition("#")
        if mark:
            items.setdefault(number, {})[field] = value
    for number, item in ((n, item) for n, item in items.items() if "model" in item):
        try:
            yield _model(path, item, licence)
        except (KeyError, ValueError) as error:
            raise InputError(f"{path}: model {number} lacks a property ({error!r})") from error


def _model(path: Path, item: Mapping[str, str], licence: str) -> CatalogueModel:
    title, category = item["name"], item["category"]
    width, depth, height = (float(item[side]) / 100 for side in ("width", "depth", "height"))
    rotation = np.array(item.get("modelRotation", "1 0 0 0 1 0 0 0 1").split(), dtype=np.float64)
    return CatalogueModel(
        name=f"{path.stem.lower()}-{item['id'].rpartition('#')[2]}",
        title=title,
        semantic=semantic_class(title) or safe_name(category.lower()),
        category=category,
        archive=path,
        member=item["model"].lstrip("/"),
        size=(width, depth, height),
        rotation=rotation.reshape(3, 3),
        creator=item.get("creator", ""),
        licence=licence,
    )


def _read_properties(path: Path) -> dict[str, str]:
    raw = _member(path, _PROPERTIES).decode("latin-1")
    text = _ESCAPE.sub(lambda code: chr(int(code[1], 16)), raw)
    lines = (line.strip() for line in text.splitlines())
    pairs = (line.partition("=") for line in lines if line and line[0] not in "#!")
    return {key.strip(): value.strip() for key, _, value in pairs}


def _member(path: Path, name: str) -> bytes:
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.read(name)
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: cannot read {name} from it ({error})") from error


def semantic_class(title: str) -> str | None:
    words = title.lower()
    table = _read_table(Path(__file__).with_suffix(".yaml"))
    if any(f"{word} " in f"{words} " and not words.endswith(word) for word in table["not"]):
        return None
    for name, endings in table["classes"].items():
        if any(words == ending or words.endswith(f" {ending}") for ending in endings):
            return str(name)
    return None


def _read_model(model: CatalogueModel) -> tuple[Mesh, dict[str, Any]]:
    from cloud_files.meshes.obj import parse_obj

    what = f"{model.archive}/{model.member}"
    return mesh_from_polygons(parse_obj(_member(model.archive, model.member), what), what, "obj")


def _to_size(mesh: Mesh, model: CatalogueModel) -> tuple[Mesh, list[float]]:
    turned = Mesh(y_up_to_z_up(mesh.vertices @ model.rotation.T), mesh.triangles)
    low, high = turned.bounds()
    extent = high - low
    flat = extent <= 0
    factors = np.where(flat, 1.0, np.array(model.size) / np.where(flat, 1.0, extent))
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    sized = Mesh((turned.vertices - foot) * factors, mesh.triangles)
    return sized, [round(float(factor), 9) for factor in factors]


def _labelled(mesh: Mesh, model: CatalogueModel) -> Mesh:
    first = np.zeros(len(mesh.triangles), dtype=np.int32)
    labels = freeform_labels(first, [SceneObject(model.name, model.semantic)])
    return Mesh(mesh.vertices, mesh.triangles, labels)
