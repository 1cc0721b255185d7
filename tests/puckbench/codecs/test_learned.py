"""What all learned codecs share: which weights are theirs, and what streams say of them."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from cloud_files.clouds import write_cloud
from pcc_networks import catalogue
from pcc_networks.weights_file import read_weights, write_weights
from pointkit.errors import InputError
from pointkit.files import read_json, sha256
from pointkit.geometry.cloud import PointCloud
from puckbench.cli import main
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.rates import rates_of
from puckbench.codecs.registry import codec_of, codecs, entry, has_weights, open_codec
from puckbench.codecs.weights_label import weights_label
from puckbench.planning.workflow import Workflow
from tests.support.codecs import decode, encode
from tests.support.learned_codecs import RATES, changes, save_tiny, shell

NAMES = list(RATES)
HEADER = (
    '{"network": "pcgcv2", "shape": {}, "lmbdas": [1, 4], "card": {}, "sha256": "", "digest": null}'
)
pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def together(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a set for each codec."""
    folder = tmp_path_factory.mktemp("together")
    for name in NAMES:
        save_tiny(name, folder / f"{name}.safetensors")
    return folder


def _codec(name: str, weights: Path | str) -> Codec:
    return open_codec(name, changes(name, weights))


@pytest.mark.parametrize("name", NAMES)
def test_of_all_sets_in_a_folder_a_codec_takes_its_own(name: str, together: Path) -> None:
    codec = _codec(name, together)
    assert not why_not_here(codec)
    stream = encode(codec, shell(), "r2")
    alone = _codec(name, together / f"{name}.safetensors")
    assert encode(alone, shell(), "r2") == stream
    assert np.array_equal(decode(alone, stream), decode(codec, stream))


@pytest.mark.parametrize("name", NAMES)
def test_the_weights_of_a_rate_have_a_name_and_a_digest(name: str, together: Path) -> None:
    file = together / f"{name}.safetensors"
    assert weights_label(_codec(name, together).weights("r1")) == f"{name} {sha256(file)[:16]}"
    assert bytes.fromhex(sha256(file)[:16]) in encode(_codec(name, together), shell(), "r2")


@pytest.mark.parametrize("name", NAMES)
def test_streams_of_other_weights_are_refused(name: str, together: Path, tmp_path: Path) -> None:
    stream = encode(_codec(name, together), shell(), "r2")
    save_tiny(name, tmp_path / "other.safetensors", seed=1)
    with pytest.raises(InputError, match=f"codec {name}: the stream was made with other weights"):
        decode(_codec(name, tmp_path), stream)


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_set_has_a_name_and_decodes_its_streams_whatever_is_given(
    name: str, together: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = {path.stem: path for path in together.glob("*.safetensors")}
    monkeypatch.setattr(catalogue, "shipped", lambda: shipped)
    stream = encode(_codec(name, name), shell(), "r2")
    save_tiny(name, tmp_path / "other.safetensors", seed=1)
    decoded = decode(_codec(name, tmp_path), stream)
    assert np.array_equal(decoded, decode(_codec(name, name), stream))


@pytest.mark.parametrize("cut", [0, 6, 200, -2], ids=["empty", "start", "header", "tensors"])
@pytest.mark.parametrize("name", NAMES)
def test_damaged_weights_are_refused(name: str, cut: int, together: Path, tmp_path: Path) -> None:
    whole = (together / f"{name}.safetensors").read_bytes()
    (tmp_path / "a.safetensors").write_bytes(whole[:cut])
    with pytest.raises(InputError, match=r"a\.safetensors"):
        encode(_codec(name, tmp_path), shell(), "r2")


@pytest.mark.parametrize(
    "header",
    ["[]", '{"network": "pcgcv2"}', '{"lmbdas": [[]]}', "{", HEADER.replace("[1, 4]", '["a"]')],
)
def test_headers_of_another_kind_are_refused(header: str, tmp_path: Path) -> None:
    tensors = {"a": np.zeros(1, np.float16)}
    metadata = {catalogue.HEADER_KEY: header}
    (tmp_path / "a.safetensors").write_bytes(save(tensors, metadata=metadata))
    assert "damaged weights" in why_not_here(_codec("pcgcv2_plus", tmp_path))


def test_safetensors_files_of_others_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.safetensors").write_bytes(save({"a": np.zeros(1, np.float16)}))
    assert "not a set of weights" in why_not_here(_codec("pcgcv2_plus", tmp_path))


def test_a_file_that_is_too_large_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "a.safetensors").open("wb") as file:
        file.truncate(catalogue.MAX_FILE_BYTES + 1)
    assert "damaged weights (more than" in why_not_here(_codec("pcgcv2_plus", tmp_path))


@pytest.mark.parametrize("name", NAMES)
def test_a_changed_number_is_found_by_its_check_sum(
    name: str, together: Path, tmp_path: Path
) -> None:
    whole = bytearray((together / f"{name}.safetensors").read_bytes())
    whole[-1] ^= 1
    (tmp_path / "a.safetensors").write_bytes(whole)
    with pytest.raises(InputError, match=r"a\.safetensors: damaged weights \(check sum\)"):
        encode(_codec(name, tmp_path), shell(), "r2")


SHAPES = {
    "pcgcv1_plus": {"channels": [4, 8, 10**9]},
    "pcgcv2_plus": {"rates": 10**9},
    "sparse_octree_net": {"channels": 10**9},
}


@pytest.mark.parametrize("name", NAMES)
def test_a_network_too_large_to_build_is_refused(name: str, together: Path, tmp_path: Path) -> None:
    path = together / f"{name}.safetensors"
    weights = read_weights(path)
    about = {**weights.header.model_dump(exclude={"sha256", "digest"}), "shape": SHAPES[name]}
    write_weights(tmp_path / "a.safetensors", about, weights.state, weights.integers)
    with pytest.raises(InputError, match=r"a\.safetensors: shape: (channels\.2|rates|channels) is"):
        encode(_codec(name, tmp_path), shell(), "r2")


@pytest.mark.parametrize(("table", "value"), [("frequencies", 0), ("length", 1), ("lowest", 2**20)])
def test_impossible_frequency_tables_are_refused(
    table: str, value: int, together: Path, tmp_path: Path
) -> None:
    weights = read_weights(together / "pcgcv2_plus.safetensors")
    integers = {name: array.copy() for name, array in weights.integers.items()}
    integers[f"frequency_tables.{table}"].flat[0] = value
    about = weights.header.model_dump(exclude={"sha256", "digest"})
    write_weights(tmp_path / "a.safetensors", about, weights.state, integers)
    with pytest.raises(InputError, match=r"a\.safetensors: damaged weights"):
        encode(_codec("pcgcv2_plus", tmp_path), shell(), "r2")


def test_a_set_may_state_the_digest_by_which_streams_name_it(
    together: Path, tmp_path: Path
) -> None:
    """Sets that were converted from an older format decode the streams of before."""
    weights = read_weights(together / "pcgcv2_plus.safetensors")
    stream = encode(_codec("pcgcv2_plus", together), shell(), "r2")
    about = {**weights.header.model_dump(exclude={"sha256"}), "digest": weights.digest.hex()}
    about["card"] = {"data": "another card"}
    write_weights(tmp_path / "a.safetensors", about, weights.state, weights.integers)
    codec = _codec("pcgcv2_plus", tmp_path)
    assert encode(codec, shell(), "r2") == stream
    assert weights_label(codec.weights("r2")) == f"a {weights.digest.hex()}"
    assert len(decode(codec, stream)) > 0


@pytest.mark.parametrize("name", NAMES)
def test_what_lacks_is_said(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"codec {name}: weights is None, but must be"):
        open_codec(name, {"options": {"weights": None}})
    assert "has no file of weights" in why_not_here(_codec(name, tmp_path))
    assert "no such folder" in why_not_here(_codec(name, tmp_path / "nowhere"))


def test_shipped_sets_have_what_their_codecs_ask_for() -> None:
    names = {name: entry(name)["options"]["weights"] for name in codecs() if has_weights(name)}
    assert set(catalogue.shipped()) <= set(names.values())
    for name, weights in names.items():
        assert (weights in catalogue.shipped()) != bool(why_not_here(open_codec(name)))


@pytest.mark.parametrize("name", NAMES)
def test_opening_a_codec_does_not_import_torch(name: str, together: Path) -> None:
    program = (
        "import sys; from puckbench.codecs.registry import open_codec;"
        "from puckbench.codecs.coding import why_not_here;"
        "from puckbench.codecs.registry import open_training;"
        f"why_not_here(open_codec('{name}', {{'options': {{'weights': '{together}'}}}}));"
        f"open_training('{name}', None, {{}}); print(*sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    heavy = {"torch", "constriction"} | (set() if name == "sparse_octree_net" else {"numba"})
    assert heavy & set(done.stdout.split()) == set()


def test_after_loading_a_first_call_finds_every_loop_compiled() -> None:
    """The first timed call of a cloud once took 5 s of compilation."""
    names = ["pcgcv1_plus", "pcgcv2_plus", "sparse_octree_net"]
    here = [name for name in names if not why_not_here(open_codec(name))]
    program = """
import gc
import sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from puckbench.codecs.rates import scaled_rates
from puckbench.codecs.registry import open_codec
from tests.support.codecs import decode, encode

def compiled():
    loops = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    packages = ("gpcc.", "pcc_networks.", "pointkit.")
    ours = [each for each in loops if each.py_func.__module__.startswith(packages)]
    return {each.py_func.__qualname__: len(each.signatures) for each in ours}

directions = np.random.default_rng(0).normal(size=(3000, 3))
sphere = 120 + 100 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
for name in sys.argv[1:]:
    codec = open_codec(name)
    codec.load()
    before = compiled()
    rates = list(scaled_rates(codec.rates))
    for rate in (rates[0], rates[-1]):
        decode(codec, encode(codec, sphere, rate))
    assert before
    print(*(name for name, count in compiled().items() if before.get(name) != count))
"""
    done = subprocess.run(
        [sys.executable, "-c", program, *here], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


def test_results_depend_on_what_is_in_the_file_of_weights(together: Path, tmp_path: Path) -> None:
    codec = {"options": {"weights": str(tmp_path)}, "rates": RATES["pcgcv2_plus"]}
    config = {
        "scene_sets": {"a": {"loader": "embedded_objects", "select": ["chair_01"]}},
        "datasets": {"d": {"scene_set": "a", "make": "sample"}},
        "codecs": {"pcgcv2_plus": codec, "draco": {}},
    }
    codes = []
    for name in ("pcgcv1_plus", "pcgcv2_plus"):
        (tmp_path / "a.safetensors").write_bytes((together / f"{name}.safetensors").read_bytes())
        flow, names = Workflow(config), ("dataset", "cloud", "codec")
        steps = (
            flow.step("encode", **dict(zip(names, curve, strict=True)))
            for curve in flow.plan.curves
        )
        codes.append([step.fingerprint for step in steps])
    assert codes[0][0] != codes[1][0]
    assert codes[0][1] == codes[1][1]


def test_the_record_of_a_stream_says_which_weights_made_it(together: Path, tmp_path: Path) -> None:
    write_cloud(tmp_path / "a.ply", PointCloud(shell(), about={"size": 1024}))
    words = ["--codec", "sparse_octree_net", "--rate", "r1", "--weights", str(together)]
    assert main(["encode", f"{tmp_path}/a.ply", f"{tmp_path}/a.bin", *words, "--json"]) == 0
    digest = sha256(together / "sparse_octree_net.safetensors")[:16]
    assert read_json(tmp_path / "a.bin.json")["weights"] == f"sparse_octree_net {digest}"


def test_a_stream_of_a_cloud_in_metres_holds_its_unit() -> None:
    random = np.random.default_rng(2)
    points = np.column_stack([random.uniform(0, 3, (4000, 2)), random.normal(0, 0.005, 4000)])
    in_metres = open_codec("pcgcv2_plus_rooms", {"options": {"unit": 0.001}})
    assert rates_of(in_metres, "metric").keys() == in_metres.rates.keys()
    stream = encode(in_metres, points, "r4")
    bare = open_codec("pcgcv2_plus_rooms")
    assert codec_of(stream) == "pcgcv2_plus"  # the first with their magic
    decoded = decode(bare, stream)  # which was told no unit
    np.testing.assert_allclose(decoded, decode(bare, encode(bare, points * 1000, "r4")) / 1000)
    assert np.abs(decoded - decoded.mean(axis=0)).max() < 3
    for damage in (stream[:9], stream[:4] + np.array([np.nan]).tobytes() + stream[12:]):
        with pytest.raises(InputError, match=r"damaged .its unit"):
            decode(bare, damage)
