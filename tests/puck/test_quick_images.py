"""Images that `fast` codes come back, whatever they hold; damaged parts raise one error."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pointkit.errors import InputError
from puck.quick_images import ImageCoder, ImageJob, framed
from puck.ranges import PAD


def images(seed: int, columns: int, lasers: int, farthest: int, roughness: int) -> list[ImageJob]:
    """An image of ranges, its signals and reflectivities, and one with few values."""
    random = np.random.default_rng(seed)
    ranges = random.integers(0, farthest // 2, (1, lasers))
    ranges = ranges + random.integers(0, roughness + 1, (columns, lasers))
    ranges[random.random(ranges.shape) < 0.3] = 0
    ranges[random.random(ranges.shape) < 0.01] = farthest
    signals = random.poisson(1 + roughness, ranges.shape).clip(0, 0xFFFF)
    around, seen = framed(ranges), framed(signals)
    few = np.where(random.random(ranges.shape) < 0.02, 512, 0)
    return [
        ImageJob(0, ranges, farthest),
        ImageJob(1, signals, 0xFFFF, around),
        ImageJob(2, (signals * ranges >> 8).clip(0, 0xFF), 0xFF, around, seen),
        ImageJob(3, (signals * 7).clip(0, 0xFFFF), 0xFFFF, around, seen),
        ImageJob(4, few, 0xFFFF, around),
        ImageJob(5, np.where(few, 3, ranges), farthest, reference=around),
    ]


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    columns=st.lists(st.integers(1, 60), min_size=1, max_size=3),
    lasers=st.integers(1, 40),
    farthest=st.sampled_from([0xFFFF, (1 << 24) - 1]),
    roughness=st.sampled_from([0, 3, 50, 20_000]),
)
def test_images_of_turns_come_back(
    seed: int, columns: list[int], lasers: int, farthest: int, roughness: int
) -> None:
    encoder, decoder, before = ImageCoder(), ImageCoder(), 0
    for turn, count in enumerate(columns):
        jobs = images(seed + turn, count, lasers, farthest, roughness)
        nearest = np.minimum(np.arange(count), before - 1).clip(0) + PAD if before else None
        rows = np.zeros(count, np.int64) if nearest is None else nearest
        _, parts = encoder.encode(jobs, rows)
        blank = [job._replace(values=np.zeros_like(job.values)) for job in jobs]
        for job, image in zip(jobs, decoder.decode(blank, rows, parts), strict=True):
            np.testing.assert_array_equal(image[PAD:-PAD, 1:-1], job.values)
        before = count


def test_noise_costs_its_entropy_and_steps_come_cheap() -> None:
    """Noise of 20 steps has log2(20 sqrt(2 pi e)) = 6.37 bits; a slope costs hardly any."""
    random, rows = np.random.default_rng(0), np.zeros(1024, np.int64)
    noise = np.rint(random.normal(500, 20, (1024, 64))).astype(int)
    slope = np.arange(1024)[:, None] * 3 + np.arange(64) * 1000 + 500
    coder = ImageCoder()
    _, parts = coder.encode([ImageJob(0, noise, 0xFFFF), ImageJob(1, slope, (1 << 24) - 1)], rows)
    assert 6.37 < 8 * len(parts[0]) / noise.size < 6.8
    assert 8 * len(parts[1]) / slope.size < 0.4


def test_damaged_parts_raise_one_error_or_hold_values_in_range() -> None:
    """Checksums of records tell the rest."""
    jobs, rows = images(1, 40, 16, 0xFFFF, 50), np.zeros(40, np.int64)
    _, parts = ImageCoder().encode(jobs, rows)
    random, errors = np.random.default_rng(2), 0
    for _ in range(300):
        number = int(random.integers(len(parts)))
        damaged = bytearray(parts[number])
        damaged[random.integers(len(damaged))] ^= 1 << int(random.integers(8))
        damaged = damaged[: random.integers(len(damaged) // 2, len(damaged) + 1)]
        try:
            image = ImageCoder().decode([jobs[number]], rows, [bytes(damaged)])[0]
        except InputError:
            errors += 1
        else:
            assert 0 <= image.min() <= image.max() <= jobs[number].farthest
    assert errors > 280
