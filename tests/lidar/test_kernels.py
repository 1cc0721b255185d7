"""Loops over rays, against closed forms."""

import numpy as np
import pytest

from puckbench.lidar.kernels import fill_distances


@pytest.mark.parametrize(("cosine", "found"), [(1.0, 2.0), (-2e-9, 2.0), (5e-10, 2.5)])
def test_where_a_ray_grazes_a_plane_the_distance_is_embrees(cosine: float, found: float) -> None:
    """A plane's distance is known to 2^-52, so that it is over a cosine of 1e-9 to 2e-7: as well
    as in Embree's single precision.
    """
    directions = np.array([[np.sqrt(1 - cosine**2), 0, cosine]])
    planes = np.array([[0.0, 0, 1, 2 * cosine]])
    distances, cosines = np.empty(1), np.empty(1)
    fill_distances(
        directions,
        np.array([2.5], np.float32),
        np.zeros(1, np.uint32),
        planes,
        np.zeros((1, 3)),
        (0.0, 10.0),
        distances,
        cosines,
    )
    assert (distances[0], cosines[0]) == pytest.approx((found, abs(cosine)), rel=1e-12)
