"""Sweet Home 3D's catalogues, on a look-alike with their quirks."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.scene_sets.sweethome3d import SweetHome3D, semantic_class

# A wedge with y up, 2 wide, 3 high, 1 deep; its slope rises towards -z.
WEDGE = (
    "v 0 0 0\nv 2 0 0\nv 2 0 1\nv 0 0 1\nv 0 3 0\nv 2 3 0\n"
    "f 1 2 3 4\nf 1 5 6 2\nf 4 3 6 5\nf 1 4 5\nf 2 6 3\nl 1 2\n"
)
PROPERTIES = """# A catalogue
id=Test#Models
name=Test catalogue
license=CC-BY 3.0  \xa9 Ren\xe9
dropOnTopElevation#-1

id#1=Test#stool
name#1=Bar stool
category#1=Kitchen
model#1=/test/stool/stool.obj
width#1=40.0
depth#1=50
height#1=120.0
creator#1=Ren\xe9

id#2=Test#bill
name#2=Bill 10\\u20ac
category#2=Living room
model#2=/test/bill.obj
width#2=20
depth#2=10
height#2=30
modelRotation#2=0 0 1 0 1 0 -1 0 0
creator#2=Someone

id#10=Test#Stool
name#10=Stool
category#10=Office
model#10=/test/stool/stool.obj
width#10=20
depth#10=10
height#10=30
creator#10=Someone
"""


def write_catalogue(path: Path, properties: str = PROPERTIES) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("PluginFurnitureCatalog.properties", properties.encode("latin-1"))
        archive.writestr("PluginFurnitureCatalog_fr.properties", "name#1=Tabouret")
        archive.writestr("test/stool/stool.obj", WEDGE)
        archive.writestr("test/bill.obj", WEDGE)


@pytest.fixture(params=["", "furniture", "usr/share/sweethome3d/furniture"])
def folder(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    write_catalogue(tmp_path / request.param / "Test.sh3f")
    return tmp_path


def test_models_are_found_installed_or_unpacked(folder: Path) -> None:
    models = SweetHome3D(path=str(folder))
    assert models.names() == ["test-Stool_2", "test-bill", "test-stool"]
    assert models.files("test-bill")[0].name == "Test.sh3f"


@pytest.mark.parametrize(
    ("name", "size"), [("test-stool", (0.4, 0.5, 1.2)), ("test-bill", (0.2, 0.1, 0.3))]
)
def test_models_stand_at_the_origin_in_the_catalogues_size(
    tmp_path: Path, name: str, size: tuple[float, float, float]
) -> None:
    write_catalogue(tmp_path / "Test.sh3f")
    mesh = SweetHome3D(path=str(tmp_path)).load(name).mesh
    assert mesh is not None
    x, y, z = size
    np.testing.assert_allclose(mesh.bounds(), [[-x / 2, -y / 2, 0], [x / 2, y / 2, z]], atol=1e-12)


def test_the_front_is_towards_minus_y_and_a_rotation_is_applied_first(tmp_path: Path) -> None:
    write_catalogue(tmp_path / "Test.sh3f")
    models = SweetHome3D(path=str(tmp_path))
    tops = {}
    for name in ("test-stool", "test-bill"):
        mesh = models.load(name).mesh
        assert mesh is not None
        high = mesh.vertices[mesh.vertices[:, 2] > 1e-9]
        tops[name] = high.mean(axis=0)[:2].tolist()
    # The wedge's top edge is at its back; the bill is turned so that z becomes x.
    assert tops["test-stool"] == pytest.approx([0, 0.25])
    assert tops["test-bill"] == pytest.approx([-0.1, 0])


def test_credit_licence_and_title_are_kept(tmp_path: Path) -> None:
    write_catalogue(tmp_path / "Test.sh3f")
    about = SweetHome3D(path=str(tmp_path)).load("test-bill").about
    assert about["title"] == "Bill 10€"
    assert about["licence"] == "CC-BY 3.0 © René"
    assert about["credit"] == "Someone"
    assert about["skipped"] == {"polylines": 1}
    assert about["triangles"] == 8


def test_classes_choose_models(tmp_path: Path) -> None:
    write_catalogue(tmp_path / "Test.sh3f")
    chairs = SweetHome3D(path=str(tmp_path), classes=("chair",))
    assert chairs.names() == ["test-Stool_2", "test-stool"]
    with pytest.raises(InputError, match=r"unknown name .sofa.*known: chair, living_room"):
        SweetHome3D(path=str(tmp_path), classes=("sofa",)).names()


@pytest.mark.parametrize(
    ("title", "expected"),
    [
        ("Corner sofa", "sofa"),
        ("Armchair", "chair"),
        ("Chair with cushion", "chair"),
        ("Coffee table", "table"),
        ("Table tennis bat", None),
        ("Pool table", None),
        ("Full bookcase", "bookcase"),
        ("Armchair ottoman", None),
    ],
)
def test_semantic_classes_of_real_titles(title: str, expected: str | None) -> None:
    assert semantic_class(title) == expected


@pytest.mark.parametrize(
    ("old", "new"),
    [("width#1=40.0", "width#1=wide"), ("height#1=120.0\n", ""), ("0 0 1 0 1 0 -1 0 0", "0 1")],
)
def test_a_damaged_description_is_named(tmp_path: Path, old: str, new: str) -> None:
    write_catalogue(tmp_path / "Test.sh3f", PROPERTIES.replace(old, new))
    with pytest.raises(InputError, match=r"Test\.sh3f: model [12] lacks a property"):
        SweetHome3D(path=str(tmp_path)).names()


def test_a_missing_model_or_a_damaged_archive_is_named(tmp_path: Path) -> None:
    path = tmp_path / "Test.sh3f"
    write_catalogue(path, PROPERTIES.replace("/test/bill.obj", "/test/gone.obj"))
    with pytest.raises(InputError, match=r"Test\.sh3f: cannot read test/gone\.obj"):
        SweetHome3D(path=str(tmp_path)).load("test-bill")
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(InputError, match=r"Test\.sh3f: cannot read"):
        SweetHome3D(path=str(tmp_path)).names()
