"""The leaderboard's page: codecs of a study in the order of their bits, the best one bold."""

from __future__ import annotations

import importlib.util
import re
from dataclasses import replace
from types import ModuleType

import pandas as pd
import pytest

from puckbench.report.reference_results import ReferenceResults, read_reference
from tests.support import reference_lookalike
from tests.support.pages import ROOT


@pytest.fixture(scope="module")
def pages() -> ModuleType:
    """The extension of the site that writes pages from the program."""
    file = ROOT / "docs" / "extensions" / "generated_reference.py"
    spec = importlib.util.spec_from_file_location("generated_reference", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> ReferenceResults:
    """Draco and G-PCC, which needs 0.8 of its bits."""
    folder = tmp_path_factory.mktemp("study")
    return read_reference(str(reference_lookalike.write_study(folder / "known.parquet")))


def rows_of(page: str) -> list[list[str]]:
    """The cells of the tables' rows, without the heads."""
    bodies = re.findall(r"<tbody>(.*?)</tbody>", page, re.DOTALL)
    rows = [row for body in bodies for row in re.findall(r"<tr>(.*?)</tr>", body)]
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]


def test_the_codec_with_the_fewest_bits_stands_first_and_is_bold(
    pages: ModuleType, study: ReferenceResults
) -> None:
    page = pages._study(study)
    assert page.startswith("## Known (`known`)")
    assert '<a href="results/known/index.html">' in page
    assert '<a href="results/known/tables/metrics.csv">' in page
    assert "BD-rates are against G-PCC. Times: medians over clouds and rates." in page
    assert "### Things, 4 clouds" in page
    gpcc, draco = rows_of(page)
    assert gpcc[:2] == ["G-PCC", "<strong>0 %</strong><small>reference</small>"]
    value = "+25.0\N{NO-BREAK SPACE}%"  # 1 / 0.8 - 1
    assert draco[:2] == ["Draco", f"{value}<small>{value} to {value}, 4 clouds</small>"]
    seconds = ("0.1", "0.05")  # of both, so neither is the fastest
    timed = [f"{value}\N{NO-BREAK SPACE}s<small>not ranked</small>" for value in seconds]
    assert draco[3:] == gpcc[3:] == timed


def test_codecs_stand_by_their_bits_and_last_where_they_cannot_be_compared(
    pages: ModuleType, study: ReferenceResults
) -> None:
    """Half of Draco's bits, which is less than G-PCC's; and a quality that no other reaches."""
    thrifty = reference_lookalike.rows_of("puck", 0.5)
    apart = reference_lookalike.rows_of("primitives", 0.01)
    apart["d1_psnr"] += 1000
    apart["d2_psnr"] += 1000
    original = study.metrics.drop(columns="digest")
    metrics = pd.concat([apart, original, thrifty], ignore_index=True)
    digests = dict(zip(study.metrics["cloud"], study.metrics["digest"], strict=True))
    metrics.insert(2, "digest", metrics["cloud"].map(digests))
    page = pages._study(replace(study, metrics=metrics))
    rows = rows_of(page)
    assert [row[0] for row in rows] == ["Puck", "G-PCC", "Draco", "Primitives"]
    assert rows[0][1].startswith("<strong>−37.5")  # 0.5 / 0.8 - 1
    assert rows[-1][1] == "–<small>no common range</small>"


def test_what_is_not_timed_says_why_in_place_of_times(
    pages: ModuleType, study: ReferenceResults
) -> None:
    rows = study.metrics.drop(columns=["encode_s", "decode_s"])
    about = {**study.about, "not_timed": "the machine was <busy>"}
    page = pages._study(ReferenceResults("known", rows, about))
    assert "Not timed: the machine was &lt;busy&gt;." in page
    assert "Time to encode" not in page
    assert "Times:" not in page


def test_titles_are_text_not_markup(pages: ModuleType, study: ReferenceResults) -> None:
    style = [{"dataset_titles": {"objects": "Things"}, "codec_titles": {"gpcc": "G<b>PCC"}}]
    page = pages._study(replace(study, about={**study.about, "style": style}))
    assert "G&lt;b&gt;PCC</th>" in page
