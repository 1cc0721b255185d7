"""The leaderboard's page: the codecs of a study, their bits, and what may be said of them."""

from __future__ import annotations

import re
from dataclasses import replace
from types import ModuleType

import pytest

from puckbench.report.reference_results import ReferenceResults, read_reference
from tests.support import reference_lookalike
from tests.support.pages import extension


@pytest.fixture(scope="module")
def pages() -> ModuleType:
    """The extension of the site that writes pages from the program."""
    return extension("generated_reference")


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


def test_a_study_has_its_bd_rates_and_no_winner_below_six_scenes(
    pages: ModuleType, study: ReferenceResults
) -> None:
    page = pages._study(study)
    assert page.startswith("## Known (`known`)")
    assert '<a href="results/known/index.html">' in page
    assert '<a href="results/known/tables/metrics.csv">' in page
    assert "BD-rates are against G-PCC." in page
    assert "### Things, 4 clouds" in page
    assert "* BD-rate, D1: no verdict: fewer than 6 scenes with comparable curves." in page
    rows = {row[0]: row[1:] for row in rows_of(page)}
    assert rows["G-PCC"][0] == "0 %<small>reference</small>"
    value = "+25.0\N{NO-BREAK SPACE}%"  # 1 / 0.8 - 1
    note = f"{value} to {value}, 4 scenes, no verdict"
    assert rows["Draco"][0] == f"{value}<small>{note}</small>"


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
