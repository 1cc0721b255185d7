"""The codec Inter-LPCM: what it codes, and where it finds its weights."""

from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from puckbench.codecs.base import CloudKind
from puckbench.codecs.registry import open_codec
from tests.support.codecs import decode, encode
from tests.support.learned_codecs import lpcm_states, lpcm_turn, save_lpcm

pytestmark = pytest.mark.usefixtures("one_thread")


def test_the_codec_codes_metres_and_finds_its_weights(tmp_path: Path) -> None:
    archive = tmp_path / "Inter-LPCM-main.zip"
    save_lpcm(archive)
    codec = open_codec("inter_lpcm", {"options": {"weights": str(archive)}})
    stream = encode(codec, lpcm_turn(), "20mm")
    assert np.abs(decode(codec, stream) - lpcm_turn()).max() <= 0.01 + 1e-9
    wide = CloudKind("metric", extent_m=400)
    assert "400 m wide" in str(codec.skip(wide, "20mm"))
    assert codec.weights("20mm") == archive
    assert "no weights: set the option weights" in str(
        open_codec("inter_lpcm").skip(CloudKind("metric"), "20mm")
    )
    save_lpcm(tmp_path / "b.zip", lpcm_states(seed=1))
    other = open_codec("inter_lpcm", {"options": {"weights": str(tmp_path / "b.zip")}})
    with pytest.raises(InputError, match="made with other weights"):
        decode(other, stream)
