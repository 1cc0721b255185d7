"""Codecs with one fault each, which a check must name, and right ones that must pass."""

# ruff: noqa: ANN001, ANN201, RUF012 (as users write codecs)

import hashlib
import itertools
import os
import struct
import subprocess
import tempfile
import time
import zlib
from pathlib import Path

import numpy as np

from pointkit.damage import PARSER_FAULTS, reading
from pointkit.measurement import NO_COST
from puckbench.codecs.base import Codec, PointCloud, lengths, parameters_of

HERE = Path(__file__).parent


class Right(Codec):
    version = "1"
    rates = {"r1": {"step": 16}, "r2": {"step": 8}, "r3": {"step": 4}, "r4": {"step": 2}}

    def encode(self, cloud, rate, work=None):
        step = np.float64(self.step(rate))
        cells = np.unique(np.round(cloud.xyz / step).astype("<i4"), axis=0)
        return step.tobytes() + zlib.compress(cells.T.tobytes(), 1)

    def step(self, rate):
        return self.rates[rate]["step"]

    def decode(self, stream):
        with reading("stream of grid", *PARSER_FAULTS, zlib.error):
            cells = np.frombuffer(zlib.decompress(stream[8:]), "<i4").reshape(3, -1).T
            return PointCloud(cells * np.frombuffer(stream[:8]))


class InMetres(Right):
    rates = lengths(50, 10)

    def step(self, rate):
        return parameters_of(self, rate)["step_m"]


class Attributed(Right):
    """Raw points with reflectances and colours."""

    attributes = ("reflectance", "colour")
    rates = {"r1": {}}

    def encode(self, cloud, rate):
        shades = cloud.fields.get("intensity", np.zeros(len(cloud))).astype("<u2")
        colours = np.zeros((len(cloud), 3), "u1") if cloud.colours is None else cloud.colours
        parts = (cloud.xyz.astype("<f8"), shades, colours)
        return b"".join(part.tobytes() for part in parts)

    def decode(self, stream):
        with reading("stream of attributes", *PARSER_FAULTS):
            n = len(stream) // 29
            xyz = np.frombuffer(stream[: 24 * n], "<f8").reshape(n, 3)
            shades = np.frombuffer(stream[24 * n : 26 * n], "<u2")
            colours = np.frombuffer(stream[26 * n :], "u1").reshape(n, 3)
            return self.cloud(xyz, shades, colours)

    def cloud(self, xyz, shades, colours):
        return PointCloud(xyz, colours=colours, fields={"reflectance": shades})


# ---- what comes back


class ChangesItsInput(Right):
    def encode(self, cloud, rate):
        cloud.xyz[:] = np.round(cloud.xyz)
        return super().encode(cloud, rate)


class ReturnsAList(Right):
    def decode(self, stream):
        return super().decode(stream).xyz.tolist()


class ForgetsItsStep(Right):
    def decode(self, stream):
        return super().decode(np.float64(1).tobytes() + stream[8:])


class LosesPoints(Right):
    def decode(self, stream):
        return PointCloud(super().decode(stream).xyz[:172])


class Thins(Right):
    """Keeps a point of 40, exactly."""

    rates = {"r1": {"step": 1e-5}}

    def encode(self, cloud, rate):
        kept = len(cloud) // 40 if len(cloud) > 400 else len(cloud)
        return super().encode(PointCloud(cloud.xyz[:: len(cloud) // kept]), rate)


class IgnoresTheLength(InMetres):
    def step(self, rate):
        return 4 * super().step(rate)


class KnowsItsRatesAlone(InMetres):
    def step(self, rate):
        return self.rates[rate]["step_m"]


class InWrongOrder(Right):
    rates = dict(reversed(Right.rates.items()))


class IgnoresTheRate(Right):
    def step(self, rate):
        return 4


# ---- special clouds


class NeedsTwoPoints(Right):
    def encode(self, cloud, rate):
        cloud.xyz[1]
        return super().encode(cloud, rate)


class DividesByTheDistance(Right):
    def encode(self, cloud, rate):
        if len(cloud) == 2:
            int(1 / np.linalg.norm(cloud.xyz[0] - cloud.xyz[1]))
        return super().encode(cloud, rate)


class DividesByTheHeight(Right):
    def encode(self, cloud, rate):
        if len(cloud) > 2:
            int(1 / np.ptp(cloud.xyz[:, 2]))
        return super().encode(cloud, rate)


# ---- processes and side information


class WritesBesideItself(Right):
    folder = HERE

    def encode(self, cloud, rate):
        stream = super().encode(cloud, rate)
        name = hashlib.sha256(stream).digest()[:8]
        self.write(self.folder / f"{name.hex()}.side", stream)
        return name + bytes(self.rates[rate]["step"] < 16)

    def decode(self, stream):
        with reading("name", *PARSER_FAULTS):
            return super().decode(self.read(self.folder / f"{stream[:8].hex()}.side"))

    def write(self, path, data):
        path.write_bytes(data)

    def read(self, path):
        return path.read_bytes()


class WritesTemporaryFiles(WritesBesideItself):
    @property
    def folder(self):
        return Path(tempfile.gettempdir())


class Remembers(WritesBesideItself):
    clouds = {}

    def write(self, path, data):
        self.clouds[path] = data

    def read(self, path):
        return self.clouds[path]


class WritesByPrograms(WritesBesideItself):
    """Python's audit does not see these files."""

    def write(self, path, data):
        subprocess.run(["tee", path], input=data, stdout=subprocess.DEVNULL, check=True)

    def read(self, path):
        done = subprocess.run(["cat", path], capture_output=True, check=False)
        return done.stdout


class LeavesALog(Right):
    def encode(self, cloud, rate):
        (HERE / "coding.log").write_text("coded")
        return super().encode(cloud, rate)


class Varies(Right):
    levels = itertools.cycle([1, 9])

    def encode(self, cloud, rate):
        stream = super().encode(cloud, rate)
        return stream[:8] + zlib.compress(zlib.decompress(stream[8:]), next(self.levels))


class Wavers(Right):
    def decode(self, stream):
        return PointCloud(super().decode(stream).xyz + np.random.default_rng().random() / 1000)


class WritesASet(Right):
    def encode(self, cloud, rate):
        names = {f"p{number}" for number in range(20)}
        return super().encode(cloud, rate) + "".join(names).encode()

    def decode(self, stream):
        with reading("stream", *PARSER_FAULTS, zlib.error):
            cells = zlib.decompressobj().decompress(stream[8:])
            cells = np.frombuffer(cells, "<i4").reshape(3, -1).T
            return PointCloud(cells * np.frombuffer(stream[:8]))


class Work:
    saved = NO_COST
    step = None


class SharesTooMuch(Right):
    def prepare(self, cloud):
        return Work()

    def encode(self, cloud, rate, work=None):
        note = b""
        if work is not None:
            work.step = work.step or self.step(rate)
            note = struct.pack("<d", work.step)
        return super().encode(cloud, rate) + (note if note != struct.pack("<d", 16) else b"")

    decode = WritesASet.decode


# ---- attributes, damage, description, cost


class DropsColours(Attributed):
    def cloud(self, xyz, shades, colours):
        return PointCloud(xyz, fields={"reflectance": shades})


class MixesReflectances(Attributed):
    def cloud(self, xyz, shades, colours):
        return super().cloud(xyz, shades[::-1], colours)


class RaisesOnDamage(Right):
    def decode(self, stream):
        cells = np.frombuffer(zlib.decompress(stream[8:]), "<i4").reshape(3, -1).T
        return PointCloud(cells * np.frombuffer(stream[:8]))


class SleepsOnDamage(Right):
    def decode(self, stream):
        try:
            return super().decode(stream)
        except Exception:
            time.sleep(5.5)
            raise


class TakesMemoryOnDamage(Right):
    def encode(self, cloud, rate):
        return struct.pack("<I", len(cloud)) + super().encode(cloud, rate)

    def decode(self, stream):
        with reading("stream", *PARSER_FAULTS):
            np.ones(64 * struct.unpack("<I", stream[:4])[0])
        return super().decode(stream[4:])


class HasNoVersion(Right):
    version = ""


class ExplainsAtLength(Right):
    def skip(self, cloud, rate):
        return None if cloud.frame == "scaled" else "It needs scaled clouds.\nPrepare it."


class TakesLong(Right):
    def encode(self, cloud, rate):
        time.sleep((len(cloud) / 20_000) ** 2)
        return super().encode(cloud, rate)


class TakesLongerThanPlanned(Right):
    costs = {"million_s": 2}

    def encode(self, cloud, rate):
        time.sleep(len(cloud) / 40_000)
        return super().encode(cloud, rate)


# ---- what ends or leaves the process


class Exits(Right):
    def encode(self, cloud, rate):
        os._exit(3)


class ExitsOnOnePoint(Right):
    def encode(self, cloud, rate):
        if len(cloud) == 1:
            os._exit(3)
        return super().encode(cloud, rate)


class CallsExit(Right):
    def encode(self, cloud, rate):
        raise SystemExit(4)


class Moves(Right):
    def encode(self, cloud, rate):
        os.chdir("/")
        return super().encode(cloud, rate)


class StartsPrograms(Right):
    def encode(self, cloud, rate):
        subprocess.Popen(["sleep", "1234"])
        return super().encode(cloud, rate)


class HangsInDecode(Right):
    def decode(self, stream):
        for _ in itertools.count():
            pass


class FailsToLoad(Right):
    def load(self):
        raise RuntimeError("no licence")
