"""Classification by PointNet: the same scores as PyTorch's own layers, and the rules around it."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.metrics.further_metrics.object_classification import ObjectClassification
from puckbench.metrics.pointnet import CLASSES, in_unit_sphere, read_pointnet, y_up

torch = pytest.importorskip("torch")

OF_POINTS = (3, 64, 64, 64, 128, 1024)
OF_OBJECT = (1024, 512, 256, 40)
OPTIONS = {"points": 50, "samples": 1}


def layers() -> dict[str, torch.nn.Module]:
    """The layers of learning3d's classifier by name, with random weights and running averages."""
    torch.manual_seed(0)
    parts = {}
    for k, (inputs, outputs) in enumerate(pairwise(OF_POINTS), start=1):
        parts[f"feature_model.conv{k}"] = torch.nn.Conv1d(inputs, outputs, 1)
        parts[f"feature_model.bn{k}"] = torch.nn.BatchNorm1d(outputs)
    for k, (inputs, outputs) in enumerate(pairwise(OF_OBJECT), start=1):
        parts[f"linear{k}"] = torch.nn.Linear(inputs, outputs)
        if k < 3:
            parts[f"bn{k}"] = torch.nn.BatchNorm1d(outputs)
    for part in parts.values():
        if isinstance(part, torch.nn.BatchNorm1d):
            part.running_mean.normal_(0, 0.3)
            part.running_var.uniform_(0.3, 2)
            torch.nn.init.normal_(part.weight, 1, 0.2)
        part.eval()
    return parts


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("weights") / "best_model.t7"
    state = {
        f"{name}.{key}": value
        for name, part in layers().items()
        for key, value in part.state_dict().items()
    }
    torch.save(state, file)
    return str(file)


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(50, 3)) * (1.0, 0.4, 2.0)


def scores_of_torch(points: np.ndarray) -> np.ndarray:
    parts = layers()
    with torch.no_grad():
        values = torch.tensor(points.T[None], dtype=torch.float32)
        for k in range(1, 6):
            values = parts[f"feature_model.conv{k}"](values)
            values = torch.relu(parts[f"feature_model.bn{k}"](values))
        values = values.max(dim=2)[0]
        for k in (1, 2):
            values = torch.relu(parts[f"bn{k}"](parts[f"linear{k}"](values)))
        return parts["linear3"](values)[0].numpy()


def test_scores_are_those_of_the_layers_of_pytorch(weights: str, points: np.ndarray) -> None:
    network = read_pointnet(Path(weights))
    scores = network.scores(points)
    np.testing.assert_allclose(scores, scores_of_torch(points), atol=2e-5)
    probabilities = torch.softmax(torch.tensor(scores), 0).numpy()
    np.testing.assert_allclose(network.probabilities(points), probabilities)


def test_clouds_are_scaled_to_the_unit_sphere_with_y_up(points: np.ndarray) -> None:
    inside = in_unit_sphere(points)
    np.testing.assert_allclose(inside.mean(axis=0), 0, atol=1e-12)
    assert np.linalg.norm(inside, axis=1).max() == pytest.approx(1)
    assert y_up(np.array([[1.0, 2, 3]])).tolist() == [[1, 3, -2]]
    assert y_up(np.array([[1.0, 2, 3]]), 1).tolist() == [[-2, 3, -1]]
    for turns in range(4):  # proper rotations
        assert np.linalg.det(y_up(np.eye(3), turns)) == pytest.approx(1)


def test_the_class_of_the_group_is_the_true_one(weights: str, points: np.ndarray) -> None:
    metric = ObjectClassification(PointCloud(points), **OPTIONS, weights=weights)
    values = metric(PointCloud(points))
    found = values["class_found"]
    assert values == {"class_agreement_percent": 100.0, "class_found": found}
    other = CLASSES[CLASSES.index(found) - 1]
    for group, right in ((found, 100), (found.upper(), 100), (other, 0)):
        cloud = PointCloud(points, about={"group": group})
        values = ObjectClassification(cloud, **OPTIONS, weights=weights)(cloud)
        assert values["class_right_percent"] == values["class_undecoded_right_percent"] == right
        assert 0 < values["class_probability_percent"] < 100
    human = PointCloud(points, about={"group": "Human"})
    assert "class_right_percent" in ObjectClassification(human, **OPTIONS, weights=weights)(human)


def test_an_object_is_seen_alike_from_four_sides(weights: str, points: np.ndarray) -> None:
    turned = points @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    clouds = [PointCloud(each, about={"group": "person"}) for each in (points, turned)]
    first, second = (
        ObjectClassification(each, **OPTIONS, weights=weights)(each) for each in clouds
    )
    assert first["class_probability_percent"] == pytest.approx(second["class_probability_percent"])
    headed = [
        ObjectClassification(cloud, **OPTIONS, weights=weights, quarter_turns=turns)(cloud)
        for cloud, turns in zip(clouds, (1, 0), strict=True)
    ]
    assert headed[0]["class_probability_percent"] == pytest.approx(
        headed[1]["class_probability_percent"]
    )


def test_large_clouds_are_sampled_alike_every_time(weights: str) -> None:
    many = PointCloud(np.random.default_rng(1).normal(size=(5000, 3)), about={"group": "chair"})
    values = [ObjectClassification(many, **OPTIONS, weights=weights)(many) for _ in range(2)]
    assert values[0] == values[1]
    assert values[0]["class_agreement_percent"] == 100


def test_other_files_are_refused_in_one_line(
    weights: str, points: np.ndarray, tmp_path: Path
) -> None:
    state = torch.load(weights, weights_only=True)
    lacking, other, text = (tmp_path / name for name in ("lacking.t7", "other.t7", "text.t7"))
    torch.save({name: value for name, value in state.items() if name != "linear3.bias"}, lacking)
    torch.save({**state, "linear3.weight": torch.zeros(10, 256)}, other)
    text.write_text("no weights")
    for file in (lacking, other, text):
        with pytest.raises(InputError, match=f"{file.name}: not the weights of learning3d's"):
            read_pointnet(file)
    with pytest.raises(InputError, match=r"absent.t7: no such file"):
        ObjectClassification(PointCloud(points), weights=str(tmp_path / "absent.t7"))
    with pytest.raises(InputError, match="points and samples must be at least 1"):
        ObjectClassification(PointCloud(points), weights=weights, points=0)
