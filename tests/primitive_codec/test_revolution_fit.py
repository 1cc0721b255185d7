"""Hypotheses of surfaces of revolution and their robust fit, against solids and SciPy."""

import platform
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import least_squares

from primitive_codec.revolution import CONE, SPHERE, RevolutionSurface, orthogonal_axes
from primitive_codec.revolution_fit import fit_revolution
from primitive_codec.revolution_hypotheses import make_hypotheses, surface_of_hypothesis
from tests.support.processors import printed_on_processors

AXIS = np.array([0.36, 0.48, 0.8])
CENTRE = np.array([40.0, 50.0, 30.0])
SURFACES = {
    "cylinder": RevolutionSurface(CONE, CENTRE, AXIS, 12.0, 0.0, -20, 40),
    "cone": RevolutionSurface(CONE, CENTRE, AXIS, 12.0, 0.3, -20, 40),
    "sphere": RevolutionSurface(SPHERE, CENTRE, np.array([0.0, 0.0, 1.0]), 15.0, 0.0, -20, 40),
}
all_surfaces = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES.keys())


@dataclass
class Samples:
    """Points and normals on a surface, the points off it by some noise."""

    xyz: np.ndarray
    normals: np.ndarray

    @classmethod
    def of(cls, surface: RevolutionSurface, count: int, noise: float = 0.0) -> "Samples":
        rng = np.random.default_rng(7)
        xyz, normals = surface.points_at(rng.uniform(-18, 18, count), rng.uniform(-3, 3, count))
        return cls(xyz + rng.normal(0, noise, (count, 1)) * normals, normals)


def askew(surface: RevolutionSurface) -> RevolutionSurface:
    """A surface somewhat off, as a hypothesis is."""
    u, v = orthogonal_axes(surface.axis)
    origin = surface.origin + 0.8 * u - 0.5 * v
    axis = surface.axis
    if surface.kind == CONE:
        axis = axis + 0.08 * u - 0.05 * v
        axis = axis / np.linalg.norm(axis)
    return surface._replace(origin=origin, axis=axis, radius=surface.radius + 1.0)


@all_surfaces
def test_a_fit_to_exact_points_has_no_error(surface: RevolutionSurface) -> None:
    xyz = Samples.of(surface, 400).xyz
    fitted = fit_revolution(askew(surface), xyz, 1.0)
    assert np.abs(fitted.coordinates(xyz)[2]).max() < 1e-4
    assert fitted.kind == surface.kind
    assert abs(fitted.axis @ surface.axis) == pytest.approx(1, abs=1e-6)


@all_surfaces
def test_a_fourth_of_outliers_does_not_pull_a_fit_away(surface: RevolutionSurface) -> None:
    samples = Samples.of(surface, 400, noise=0.05)
    far = np.arange(400) % 4 == 0
    samples.xyz[far] += 3.0 * samples.normals[far]
    fitted = fit_revolution(askew(surface), samples.xyz, 0.1)
    off = fitted.coordinates(samples.xyz[~far])[2]
    assert np.sqrt(np.mean(off**2)) < 0.12  # 1.5 of the least squares without a robust loss


@all_surfaces
def test_a_fit_is_as_good_as_that_of_scipy(surface: RevolutionSurface) -> None:
    xyz, scale = Samples.of(surface, 400, noise=0.3).xyz, 0.5
    start = askew(surface)
    u, v = orthogonal_axes(start.axis)

    def distances(x: np.ndarray) -> np.ndarray:
        axis = start.axis + x[3] * u + x[4] * v
        moved = start._replace(
            origin=start.origin + x[:3],
            axis=axis / np.linalg.norm(axis),
            radius=start.radius + x[5],
            angle=start.angle + x[6],
        )
        return moved.coordinates(xyz)[2]

    def loss(off: np.ndarray) -> float:
        return float((np.sqrt(1 + (off / scale) ** 2) - 1).sum())

    theirs = least_squares(distances, np.zeros(7), loss="soft_l1", f_scale=scale)
    ours = fit_revolution(start, xyz, scale).coordinates(xyz)[2]
    assert loss(ours) <= 1.001 * loss(distances(theirs.x))


@all_surfaces
def test_hypotheses_lie_on_a_solid_of_their_kind(surface: RevolutionSurface) -> None:
    samples = Samples.of(surface, 4000)
    scene = np.concatenate([samples.xyz, samples.xyz[:1] + 100])  # round things fill no scene
    normals = np.concatenate([samples.normals, samples.normals[:1]])
    rows = make_hypotheses(scene, normals, np.arange(0, 4000, 40), 1.0, 0.1)
    fitted = [surface_of_hypothesis(row) for row in rows]
    of_kind = [
        each
        for each in fitted
        if each.kind == surface.kind and (each.angle > 0) == (surface.angle > 0)
    ]
    off = [np.abs(each.coordinates(samples.xyz)[2]).max() for each in of_kind]
    assert np.mean(np.array(off) < 1e-6) > 0.9  # some of the samples' normals are almost parallel
    best = of_kind[int(np.argmin(off))]
    assert best.angle == pytest.approx(surface.angle, abs=1e-6)


def test_a_plane_has_no_hypotheses() -> None:
    rng = np.random.default_rng(0)
    xyz = np.column_stack([100 * rng.random((3000, 2)), np.zeros(3000)])
    normals = np.tile([0.0, 0.0, 1.0], (3000, 1))
    assert len(make_hypotheses(xyz, normals, np.arange(0, 3000, 30), 2.0, 0.1)) == 0


_ENCODE = """
import hashlib
import numpy as np
from primitive_codec import RATES, PrimitiveSettings, decode, encode
rng = np.random.default_rng(0)
turn, up = 6.3 * rng.random(4000), rng.random(4000)
tube = np.column_stack([150 * np.cos(turn) + 3, 150 * np.sin(turn), 600 * up])
ball = rng.normal(size=(4000, 3))
ball *= 120 / np.sqrt((ball * ball).sum(axis=1))[:, None]
lean = np.array([[0.96, 0.28, 0.0], [-0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
wall = np.column_stack([900 * rng.random(4000), np.zeros(4000), 600 * rng.random(4000)])
wall = (wall[:, :, None] * lean.T[None]).sum(axis=1)
cloud = np.concatenate([tube, ball + [400, 0, 300], wall + [0, 250, 0]])
cloud = np.round(cloud + rng.normal(0, 1, cloud.shape), 3)
digest = hashlib.sha256(cloud.tobytes())
for rate in ("r2", "r4", "r7"):
    stream = encode(cloud, PrimitiveSettings(**RATES[rate]))
    digest.update(stream + np.round(decode(stream), 6).tobytes())
print(digest.hexdigest())
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names instructions of x86-64")
def test_streams_and_points_do_not_depend_on_the_instructions_of_libraries() -> None:
    """The last digits of points do: they come from sines and cosines of the C library."""
    assert len(printed_on_processors(_ENCODE)) == 1
