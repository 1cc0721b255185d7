"""The modules that a user's plug-in imports from elsewhere, and the files that its code names."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path

import pytest

from puckbench.steps.user_code import imported_files, named_files, with_libraries


def write(path: Path, text: str = "") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.fixture
def codec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file for a codec in a folder of a project, in which the run is started."""
    monkeypatch.chdir(tmp_path)
    return write(tmp_path / "codecs" / "mine.py")


@pytest.mark.parametrize(
    "statement",
    [
        "import far_library.steps",
        "from far_library import steps",
        "from far_library.steps import SIZE",
        "def encode():\n    from far_library.steps import SIZE",
        "try:\n    import far_library.steps as s\nexcept ImportError:\n    s = None",
    ],
)
def test_imports_of_any_form_count(
    codec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, statement: str
) -> None:
    folder = tmp_path / "lib" / "far_library"
    package = write(folder / "__init__.py")
    steps = write(folder / "steps.py", "from ._sizes import SIZE\n")
    sizes = write(folder / "_sizes.py", "SIZE = 1\n")
    write(folder / "unused.py")
    monkeypatch.syspath_prepend(folder.parent)
    write(codec, f"import json, numpy, puckbench.codecs.base\n{statement}\n")
    assert imported_files(codec) == {package, steps, sizes}


def test_editable_installs_count(
    codec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some put a finder of their package on Python's list, not a folder on its path."""
    file = write(tmp_path / "lib" / "far_library.py")

    class Finder:
        @staticmethod
        def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
            return spec_from_file_location(name, file) if name == "far_library" else None

    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, Finder])
    write(codec, "import far_library\n")
    assert imported_files(codec) == {file}


def test_modules_beside_in_folders_without_init_count(codec: Path) -> None:
    deep = write(codec.parent / "parts" / "deep" / "first.py")
    write(codec, "import parts.deep.first\n")
    assert imported_files(codec) == {deep}


def test_files_with_syntax_errors_import_nothing(codec: Path) -> None:
    assert imported_files(write(codec, "def encode(:\n")) == set()


def test_extension_modules_are_files_that_the_code_imports(codec: Path) -> None:
    module = write(codec.parent / "_mine.so")
    write(codec, "import _mine\n")
    assert named_files(codec, [], set()) == {module}


@pytest.mark.parametrize(
    ("code", "name"),
    [
        ('json.load(open("codecs/table.json"))', "codecs/table.json"),
        ('HERE / "table.json"', "codecs/table.json"),
        ('HERE / "models" / "small" / "a.pt"', "codecs/models/small/a.pt"),
        ('HERE / "models" / f"{rate}.pt"', "codecs/models/r1.pt"),
        ('HERE / f"model_{rate}.npz"', "codecs/model_r1.npz"),
        ('HERE / ("model_%s.npz" % rate)', "codecs/model_r1.npz"),
        ('HERE / "model_{}.npz".format(rate)', "codecs/model_r1.npz"),
        ('HERE / (rate + ".npz")', "codecs/r1.npz"),
        ('Path(__file__).with_suffix(".bin")', "codecs/mine.bin"),
        ('HERE.glob("*.txt")', "codecs/words.txt"),
        ('HERE.parent / "weights" / "a.onnx"', "weights/a.onnx"),
        ('subprocess.run(["./build/mycodec"])', "build/mycodec"),
        ('ctypes.CDLL(HERE / "libmine.so")', "codecs/libmine.so"),
        ('numpy.ctypeslib.load_library("libmine", HERE)', "codecs/libmine.so"),
        ('run(["julia", HERE / "tool.jl"])', "codecs/tool.jl"),
    ],
)
def test_files_that_the_code_names_count(codec: Path, tmp_path: Path, code: str, name: str) -> None:
    named = write(tmp_path / name)
    for other in ("notes.txt", "codecs/notes.md", "codecs/other.json", "codecs/models/b.bin"):
        write(tmp_path / other)
    write(codec, f"def encode():\n    return {code}\n")
    assert named_files(codec, [], set()) == {named}


def test_files_that_no_text_names_do_not_count(codec: Path, tmp_path: Path) -> None:
    for name in ("notes.txt", "config.yaml", "codecs/r1", "codecs/README.md", "codecs/a.b"):
        write(tmp_path / name)
    write(
        codec, 'rates = {f"r{k}": k for k in "12"}\nprint(f"{1}.{2}", f"{1:.2f}", "{}", "/", "")\n'
    )
    assert named_files(codec, [], set()) == set()


def test_absolute_paths_count(codec: Path, tmp_path: Path) -> None:
    weights, other = write(tmp_path / "far" / "w.npz"), write(tmp_path / "far" / "v.npz")
    of_file = write(codec.with_name("a.py"), f"np.load({str(weights)!r})\n")
    assert named_files(of_file, [], set()) == {weights}
    of_folder = write(codec.with_name("b.py"), f'Path({str(weights.parent)!r}) / "w.npz"\n')
    assert named_files(of_folder, [], set()) == {weights}
    pattern = str(weights.parent / "*.npz")
    of_pattern = write(codec.with_name("c.py"), f"glob({pattern!r})\nopen('/proc/cpuinfo')\n")
    assert named_files(of_pattern, [], set()) == {weights, other}


def test_paths_that_cannot_exist_are_no_files(codec: Path) -> None:
    write(codec, f'open("/{"ä" * 200}"), open("/\\ud800"), open("a\\0b"), open("~/none.npz")\n')
    assert named_files(codec, [], set()) == set()


def test_files_that_options_name_count(codec: Path, tmp_path: Path) -> None:
    model = write(tmp_path / "models" / "a.onnx")
    assert named_files(codec, ["models/a.onnx", "fast"], set()) == {model}


def test_results_and_inputs_do_not_count(codec: Path, tmp_path: Path) -> None:
    write(codec, 'Path("results", "a.json"), ".ply"\n')
    write(tmp_path / "results" / "a.json")
    cloud = write(codec.parent / "scan.ply")
    assert named_files(codec, [], {tmp_path / "results", cloud}) == set()


def test_a_module_elsewhere_names_files_beside_it(
    codec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "lib" / "far_tables.py", 'TABLE = Path(__file__).with_name("table.csv")\n')
    table = write(tmp_path / "lib" / "table.csv")
    monkeypatch.syspath_prepend(tmp_path / "lib")
    write(codec, "import far_tables\n")
    assert named_files(codec, [], set()) == {table}


def test_libraries_beside_a_program_count_if_it_contains_their_names(tmp_path: Path) -> None:
    program = write(tmp_path / "mycodec", "\0libcore.so.1\0")
    program.chmod(0o755)
    core = write(tmp_path / "libcore.so.1", "\0libmath.so\0")
    math = write(tmp_path / "libmath.so")
    write(tmp_path / "libother.so")
    assert with_libraries([program]) == {program, core, math}
    data = write(tmp_path / "data", "libcore.so.1")
    assert with_libraries([data]) == {data}
