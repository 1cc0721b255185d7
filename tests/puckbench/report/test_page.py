"""The report, opened in headless Chromium: it draws, sorts, turns, and fetches nothing."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from html import unescape
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from puckbench.cli import main
from puckbench.report.build import build_page
from puckbench.report.contents import Contents
from puckbench.report.run_record import RunRecord
from tests.support.browser import Page, browser
from tests.support.figures_lookalike import CD_MEDIANS, metrics_table
from tests.support.report_lookalike import NASTY, STEPS, look_alike

BACKGROUND = np.array([12, 13, 16])
PAPER = np.array([21, 23, 27])
"""Of the page in the dark."""
MACHINE = {"Processor": "a & b"}
COST = {"processor_s": 30.0, "wall_s": 60.0}
RECORD = RunRecord.of(
    [
        {**COST, "ended": "2026-05-03T10:02:00+00:00", "commit": "0123456789ab"},
        {**COST, "ended": "2026-05-03T10:02:30+00:00", "commit": "0123456789ab"},
    ]
)


@dataclass(frozen=True)
class Opened:
    """The page in the browser, and its file."""

    page: Page
    file: Path


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> tuple[Contents, Path]:
    folder = tmp_path_factory.mktemp("run")
    return look_alike(folder), folder


@pytest.fixture(scope="module")
def text(contents: tuple[Contents, Path]) -> str:
    return build_page(contents[0], MACHINE, contents[1], RECORD)


@pytest.fixture(scope="module")
def opened(
    text: str, contents: tuple[Contents, Path], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Opened]:
    file = contents[1] / "report.html"
    file.write_text(text, encoding="utf-8")
    with browser(tmp_path_factory.mktemp("profile")) as page:
        page.open(file)
        yield Opened(page, file)
        assert page.faults == []
        assert [url for url in page.requests if not url.startswith(("file://", "data:"))] == []


def test_the_same_files_give_the_same_bytes(contents: tuple[Contents, Path], text: str) -> None:
    assert build_page(contents[0], MACHINE, contents[1], RECORD) == text


def test_nothing_in_the_page_comes_from_outside(text: str) -> None:
    fetched = re.findall(r'(?:src|href|action|poster|data)="([^"]*)"', text)
    outside = [url for url in fetched if not url.startswith(("data:image/png;base64,", "#"))]
    assert set(outside) == {
        "tables/summary.csv",
        "tables/uses.csv",
        "tables/bd_rate.csv",
        "tables/bd_rate_pairs.csv",
        "tables/clouds.csv",
        "tables/scan_errors.csv",
        "tables/claims.csv",
        "figures/fig_6_6.pdf",
        "figures/fig_6_6.svg",
    }
    assert "@import" not in text
    policy = re.findall(r'http-equiv="Content-Security-Policy" content="(.*?)"', text)[0]
    assert unescape(policy).startswith("default-src 'none'; img-src data:; style-src")


def test_a_run_that_tests_no_claim_shows_none(
    contents: tuple[Contents, Path], tmp_path: Path
) -> None:
    values, folder = contents
    claims = pd.read_csv(values.tables["claims"])
    claims["verdict"] = "not tested: needs other clouds"
    claims.to_csv(tmp_path / "claims.csv", index=False)
    tables = {**values.tables, "claims": str(tmp_path / "claims.csv")}
    page = build_page(values.model_copy(update={"tables": tables}), MACHINE, folder, RECORD)
    assert 'id="claims"' not in page
    assert "needs other clouds" not in page


def test_names_are_text_and_no_markup(text: str) -> None:
    assert NASTY not in text
    assert "alert(&#39;x&#39;)&lt;/script&gt;" in text
    assert "a &amp; b" in text


def test_findings_come_first_and_facts_of_the_run_last(opened: Opened) -> None:
    sections = opened.page.run("[...document.querySelectorAll('main > section')].map((s) => s.id)")
    assert sections == ["findings", "claims", "curves", "clouds", "figures", "tables", "run"]
    words = opened.page.run("document.querySelector('.byline').innerText").split("\n")
    assert words == [
        *("Date", "3 May 2026"),
        *("Duration", "90 s, 60 s of processor time in 2 jobs"),
        *("Commit", "0123456789ab"),
    ]


def test_findings_say_first_which_codec_is_for_what(opened: Opened) -> None:
    page = opened.page
    heading = "document.querySelector('#findings h3').textContent"
    assert page.run(heading) == "Which codec for what"
    rows = page.run(
        "[...document.querySelectorAll('.uses tbody tr')]"
        ".map((r) => [...r.cells].map((c) => c.textContent))"
    )
    assert [row[0] for row in rows] == [
        *["RMS error of at most 5 mm (D1)"] * 4, "nearest to the true surface (D2)",
    ]  # fmt: skip
    nearest = rows[-1]
    assert nearest[1:3] == ["S3dis noisy", "Draco"]
    assert re.fullmatch(r"nearest; G-PCC has 1\.\d+ \(.+ to .+\) times the error", nearest[-1])
    assert page.run("[...document.querySelectorAll('.best')].map((c) => c.innerText)") == ["Draco"]


def test_bd_rates_of_every_data_set_follow(opened: Opened) -> None:
    cards = opened.page.run("[...document.querySelectorAll('.finding')].map((c) => c.innerText)")
    assert len(cards) == 4
    assert cards[0].startswith("Capod 12 clouds")
    assert re.search(r"BD-rate, D1\n+no codec is better than every other; not beaten: ", cards[0])
    assert "12 scenes, better" in cards[0]


def test_claims_are_cards_wide_enough_to_read(opened: Opened) -> None:
    page = opened.page
    cards = "[...document.querySelectorAll('.claim')]"
    assert page.run(f"{cards}.map((c) => c.querySelector('.verdict').textContent)") == [
        *("holds in part", "holds", "does not hold", "not tested"),
    ]
    assert min(page.run(f"{cards}.map((c) => c.clientWidth)")) > 250
    assert page.run(f"[...{cards}[0].querySelectorAll('li')].map((i) => i.textContent)") == [
        "Draco improves: yes (CD falls 2 times; 3 at most)",
        "G-PCC improves: no (0.9)",
    ]
    assert page.run(f"{cards}[0].querySelector('a').getAttribute('href')") == "#figure-fig_6_6"
    assert page.run("document.querySelector('#table-claims')") is None


def test_bd_rates_stand_first_and_bookkeeping_behind_a_fold(opened: Opened) -> None:
    page = opened.page
    page.run("document.querySelector('#table-bd_rate').open = true")
    shown = (
        "[...document.querySelectorAll('#table-bd_rate th')]"
        ".filter((head) => head.offsetWidth).map((head) => head.title)"
    )
    first = ["dataset", "metric", "codec", "anchor", "bd_rate_percent"]
    assert page.run(shown)[:5] == first
    assert {"verdict", "scenes", "lossless"} < set(page.run(shown))
    assert "little_overlap" not in page.run(shown)
    page.click("#table-bd_rate .controls .box:last-of-type input")
    assert "little_overlap" in page.run(shown)
    first = "document.querySelector('#table-bd_rate tbody tr').innerText.split('\\t').slice(0, 3)"
    assert page.run(first) == ["Capod", "D1 PSNR", "G-PCC"]


def test_every_median_is_a_marker_and_every_curve_a_line(opened: Opened) -> None:
    page = opened.page
    assert page.run("document.querySelectorAll('svg.plot polyline').length") == len(CD_MEDIANS)
    markers = "document.querySelectorAll('svg.plot .point').length"
    assert page.run(markers) == sum(map(len, CD_MEDIANS.values()))
    page.choose("Data set", "capod")
    assert page.run(markers) == 8 + 8 + 6 + 7
    page.click("fieldset.legend label:nth-of-type(1) input")
    assert page.run(markers) == 8 + 6 + 7
    page.click("fieldset.legend label:nth-of-type(1) input")
    page.choose("Metric", "truth_cd_plane")
    assert page.run(markers) == 0
    page.choose("Metric", "cd_plane")


def test_pointing_at_a_marker_tells_its_numbers(opened: Opened) -> None:
    page = opened.page
    left, top, width, height = page.place("svg.plot [data-codec='draco'] .point")
    page.point_at(left + width / 2, top + height / 2)
    page.settle()
    words = page.run("document.querySelector('.tip').innerText")
    assert words.startswith("Draco, r1")
    assert "bpp" in words
    assert re.search(
        r"Chamfer distance, point to plane: \d+[\d.]* \(\d.* – \d.*\) grid units²", words
    )


def test_arrow_keys_walk_along_the_curves(opened: Opened) -> None:
    page = opened.page
    page.run("document.querySelector('svg.plot .point[tabindex=\"0\"]').focus()")
    at = "document.activeElement.getAttribute('aria-label').split(', ').slice(0, 2).join()"
    assert page.run(at) == "Draco,r1"
    page.press("ArrowRight")
    assert page.run(at) == "Draco,r2"
    page.press("ArrowDown")
    assert page.run(at) == "G-PCC,r2"


def test_a_heading_sorts_its_column_both_ways(opened: Opened) -> None:
    page = opened.page
    page.run("document.querySelector('#table-summary').open = true")
    column = (
        "[...document.querySelectorAll('#table-summary tbody tr')]"
        ".filter((row) => !row.hidden).map((row) => Number(row.cells[3].textContent))"
    )
    page.click("#table-summary th:nth-child(4) button")
    rising = page.run(column)
    assert len(rising) == sum(map(len, CD_MEDIANS.values()))
    assert rising == sorted(rising)
    page.click("#table-summary th:nth-child(4) button")
    assert page.run(column) == rising[::-1]
    heading = "document.querySelector('#table-summary th:nth-child(4)').getAttribute('aria-sort')"
    assert page.run(heading) == "descending"


def test_words_and_choices_filter_rows(opened: Opened) -> None:
    page = opened.page
    shown = "[...document.querySelectorAll('#table-summary tbody tr')].filter((r) => !r.hidden)"
    page.run(
        "(() => { const i = document.querySelector('#table-summary input[type=search]');"
        "i.value = 'PCGCV1 r1'; i.dispatchEvent(new Event('input')); })()"
    )
    assert page.run(f"{shown}.length") == 4
    count = "document.querySelector('#table-summary .count').textContent"
    assert page.run(count) == f"4 of {sum(map(len, CD_MEDIANS.values()))} rows"


def _drawn(picture: NDArray[np.uint8]) -> int:
    """Pixels that are not of the viewer's background."""
    return int((np.abs(picture.astype(int) - BACKGROUND).max(axis=2) > 40).sum())


def test_the_viewer_draws_the_clouds_and_turns_them(opened: Opened) -> None:
    page = opened.page
    panes = [f".pane:nth-child({n}) canvas" for n in (1, 2, 3)]
    before = [page.picture(pane) for pane in panes]
    assert min(map(_drawn, before)) > 1000
    assert page.run("document.querySelector('canvas').getContext('webgl') !== null")
    page.drag(panes[0], 120, 30)
    after = [page.picture(pane) for pane in panes]
    for old, new in zip(before, after, strict=True):
        assert (old != new).any(axis=2).sum() > 1000
    assert _drawn(after[0]) > 1000


def test_the_viewer_starts_where_most_of_the_errors_are_taken_away(
    opened: Opened, tmp_path: Path
) -> None:
    with browser(tmp_path) as page:
        page.open(opened.file)
        chosen = page.run("[...document.querySelectorAll('#viewer select')].map((s) => s.value)")
    metrics = metrics_table()
    shown = metrics[(metrics["dataset"] == "s3dis_noisy") & (metrics["cloud"] == "cloud_0")]
    pairs = {(codec, rate) for codec, rates in STEPS.items() for rate in rates}
    shown = shown.set_index(["codec", "rate"])["truth_cd_plane"]
    assert chosen == ["1", *min(pairs, key=lambda pair: shown[pair])]


def test_the_colours_of_errors_cover_what_the_codec_s_clouds_have(opened: Opened) -> None:
    page = opened.page
    for codec in STEPS:
        page.choose("Codec", codec)
        seen: list[int] = []
        for rate in STEPS[codec]:
            page.choose("Rate", rate)
            error = page.run("[...bytesOf(document.querySelector('#viewer').viewer.decoded.error)]")
            seen += error
        assert np.quantile(seen, 0.98) > 200
        assert np.quantile(seen, 0.02) < 100


def test_the_viewer_has_every_rate_of_every_codec(opened: Opened) -> None:
    page = opened.page
    for codec, rates in STEPS.items():
        page.choose("Codec", codec)
        for rate in rates:
            page.choose("Rate", rate)
            words = page.run("document.querySelectorAll('.pane figcaption')[1].innerText")
            assert re.search(rf"{rate}, [\d.]+ bpp", words)


def test_on_paper_the_plot_stays_and_controls_go(opened: Opened) -> None:
    page = opened.page
    page.show(700, 900, media="print", dark=True)
    assert page.run("getComputedStyle(document.querySelector('nav')).display") == "none"
    assert page.run("getComputedStyle(document.body).colorScheme") == "light"
    assert page.run("document.querySelector('svg.plot').getBoundingClientRect().width") > 300
    page.show(1280, 900)


@pytest.mark.parametrize("width", [360, 390, 1280])
def test_nothing_is_wider_than_the_window(opened: Opened, width: int) -> None:
    page = opened.page
    page.show(width, 800)
    page.run("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    page.settle()
    assert page.run("document.documentElement.scrollWidth") <= width
    beyond = (
        "[...document.querySelectorAll('body *')].filter((e) => !e.closest('.scroll, pre, dialog')"
        f" && e.getBoundingClientRect().right > {width} + 0.5).map((e) => e.outerHTML.slice(0, 80))"
    )
    assert page.run(beyond) == []
    page.run("document.querySelectorAll('details').forEach((d) => { d.open = false; })")
    page.show(1280, 900)


def test_on_a_telephone_a_click_makes_a_figure_larger_than_the_screen(opened: Opened) -> None:
    page = opened.page
    page.show(390, 800)
    page.click("#figure-fig_6_6 .enlarge")
    assert page.run("document.querySelector('dialog img').clientWidth") > 2 * 390
    assert page.run("document.documentElement.scrollWidth") <= 390
    page.run("document.querySelector('dialog').close()")
    page.show(1280, 900)


def test_in_the_dark_no_figure_has_a_white_ground(opened: Opened) -> None:
    page = opened.page
    right = "#figure-fig_6_6 img"  # which is white on its right side
    assert page.picture(right)[20, -3].min() > 250
    page.show(1280, 900, dark=True)
    dark = page.picture(right)
    assert np.abs(dark[20, -3].astype(int) - PAPER).max() < 8
    assert dark[20, 3].min() > 220  # black ink is light
    page.click("nav button")
    assert page.picture(right)[20, -3].min() > 250
    page.click("nav button")
    page.click("#figure-fig_6_6 .enlarge")
    assert np.abs(page.picture("dialog img")[20, -3].astype(int) - PAPER).max() < 8
    page.run("document.querySelector('dialog').close()")
    page.run("document.documentElement.style.colorScheme = ''")
    page.show(1280, 900)


def test_without_webgl_the_clouds_are_drawn_all_the_same(opened: Opened, tmp_path: Path) -> None:
    with browser(tmp_path, webgl=False) as page:
        page.open(opened.file)
        assert page.run("document.querySelector('canvas').getContext('webgl')") is None
        assert _drawn(page.picture(".pane:nth-child(3) canvas")) > 1000
        assert page.faults == []


def test_the_date_is_that_of_the_jobs_logs_and_not_of_the_page_s_own(tmp_path: Path) -> None:
    for name, job, end in (("a", "encode", "2026-05-03"), ("report", "report_page", "2026-06-01")):
        cost = {"job": job, **COST, "ended": f"{end}T10:00:00+00:00"}
        (tmp_path / f"{name}.log").write_text(f"words\n{json.dumps(cost)}\n")
    (tmp_path / "failed.log").write_text("puckbench: no such file\n")
    page = tmp_path / "page.html"
    assert main(["report", str(page), "--contents", json.dumps({"logs": str(tmp_path)})]) == 0
    assert "<dt>Date</dt><dd>3 May 2026</dd>" in page.read_text(encoding="utf-8")
    assert "in 1 jobs" not in page.read_text(encoding="utf-8")


def test_the_command_writes_a_page_of_what_there_is(
    contents: tuple[Contents, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.html"
    values = json.dumps({"metrics": contents[0].metrics})
    assert main(["report", str(page), "--contents", values]) == 0
    assert 'id="data-curves"' in page.read_text(encoding="utf-8")
    assert main(["report", str(page), "--contents", '{"title": "Mine"}']) == 0
    assert "<title>Mine</title>" in page.read_text(encoding="utf-8")
    capsys.readouterr()
    assert main(["report", str(page), "--contents", '{"metrics": "no.csv"}']) == 2
    assert capsys.readouterr().err == "puckbench: no.csv: no such file or directory\n"
