"""Captures of sensors of 32 lasers, read as tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from puckbench.recordings.reading import read_recording
from tests.support.spinning import (
    HDL32E,
    PACKET,
    VLP32C,
    pcap,
    rows,
    spin,
)


@pytest.mark.parametrize(
    ("product", "sequence_us", "elevation", "ahead", "quantum_m", "start_mm"),
    [(VLP32C, 55.296, 15.0, -1.4, 0.004, 42.4), (HDL32E, 46.08, 5.33, 0.0, 0.002, 28.96)],
)
def test_captures_of_sensors_of_32_lasers_are_tables(
    product: int, sequence_us: float, elevation: float, ahead: float, quantum_m: float,
    start_mm: float, tmp_path: Path,
) -> None:  # fmt: skip
    """The points of the 15th pair's second laser, by the sensors' descriptions elsewhere."""
    payloads = spin(product, packets=3, rise=20)
    table = payloads.view(PACKET)[:, 0]
    table["blocks"]["azimuth"] = 100 + 20 * np.arange(36).reshape(3, 12)
    table["time"] = [10, 10 + round(12 * sequence_us), 10 + round(24 * sequence_us)]
    (path := tmp_path / "a.pcap").write_bytes(pcap(rows(payloads)))
    read = read_recording(path)
    laser = {VLP32C: 29, HDL32E: 23}[product]
    delay_us = 2.304 * 14 if product == VLP32C else 1.152 * 23
    seen = read.select(read["laser_id"] == laser)
    quanta = table["blocks"]["returns"]["distance"].reshape(36, 32)[:, laser].astype(float)
    columns = np.flatnonzero(quanta)
    azimuth = np.radians((100 + 20 * (columns + delay_us / sequence_us)) / 100 + ahead)
    distance, angle = quanta[columns] * quantum_m, np.radians(elevation)
    level = distance * np.cos(angle)
    z = distance * np.sin(angle) - start_mm / 1000 * np.tan(angle)
    expected = np.column_stack([level * np.sin(azimuth), level * np.cos(azimuth), z])
    np.testing.assert_allclose(seen.xyz, expected, atol=1e-4)
    np.testing.assert_allclose(
        np.diff(seen["timestamp"]), np.diff(columns) * sequence_us * 1e-6, atol=1e-6
    )
