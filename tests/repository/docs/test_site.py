"""The site builds without a warning, fetches nothing, and stays short."""

from __future__ import annotations

import os
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

from puckbench.report.reference_results import shipped_studies
from tests.support.pages import ROOT, page

FETCHED = re.compile(
    r"""<(?:script|img|iframe)[^>]*\ssrc="(?:https?:)?//|<link[^>]*\shref="(?:https?:)?//[^>]*>"""
    r"""|@import\s+url\(["']?(?:https?:)?//"""
)

FOLDERS = "src|tests|config|workflow|benchmarks|docs|envs"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; the tutorials, which other tests run, are shown as they stand."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", str(folder)],
        cwd=ROOT,
        env={**os.environ, "DOCS_EXECUTE": "off"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-6000:]
    return folder


def test_the_site_has_every_kind_of_page(site: Path) -> None:
    for name in ("tutorials", "how-to", "reference", "explanation", "notes"):
        assert (site / name / "index.html").exists()
    assert (site / "glossary.html").exists()
    assert all(
        (site / "reference" / "results" / name / "index.html").exists()
        for name in shipped_studies()
    )


def test_the_reference_knows_the_commands_codecs_and_functions(site: Path) -> None:
    for name, words in {
        "command_line": ("puckbench scan", "--error-options", "puckbench calibrate"),
        "codecs": ("gpcc_lossless", "compression_level", "quantization_bits"),
        "error_models": ("vlp16_divergence", "bias_sigma_m", "HDL-64E"),
        "scene_sets": ("mesh_files", "metres_per_unit"),
        "tables_and_figures": ("truth_rd", "bd_rate_clouds", "residual_statistics"),
        "python": ("puckbench.library.compare", "puckbench.codecs.base.Codec"),
        "configuration": ("error_options", "sensor_study"),
        "results": ("Reference results", *shipped_studies()),
        "published": ("SparsePCGC", "86 come out again to the printed digit", "-13.377 %"),
    }.items():
        text = (site / "reference" / f"{name}.html").read_text(encoding="utf-8")
        assert all(word in text for word in words), name


def test_the_leaderboard_has_every_study(site: Path) -> None:
    text = (site / "reference" / "results.html").read_text(encoding="utf-8")
    for name in shipped_studies():
        assert f'<span class="pre">{name}</span></code>)<a class="headerlink"' in text
    assert "none yet" not in text
    assert (site / "_static" / "ranking.css").exists()
    assert 'class="docutils ranking"' in text


def test_no_page_fetches_anything(site: Path) -> None:
    pages = [*site.rglob("*.html"), *site.rglob("*.css")]
    assert len(pages) > 40
    for path in pages:
        assert not FETCHED.search(path.read_text(encoding="utf-8")), path


def test_the_user_documentation_is_short() -> None:
    """What is written by hand: not the tables of `config/README.md`, nor numbers of results."""
    pages = [path for path in (ROOT / "docs").rglob("*.md") if path.parent.name != "notes"]
    pages += [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "config/README.md")]
    made = re.compile(
        r"<!-- keys:.*?<!-- end of keys -->|<!-- shown: \w+ -->.*?<!-- end -->", re.DOTALL
    )
    texts = (made.sub("", path.read_text(encoding="utf-8")) for path in pages)
    assert sum(len(re.findall(r"\S*\w\S*", text)) for text in texts) <= 28_500
    assert len(page("README.md").splitlines()) <= 200


def test_links_have_words_where_nothing_fills_them_in() -> None:
    """As Sphinx would: the pages are read in the repository, too."""
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        assert not re.search(r"(?<!!)\[\]\(", path.read_text(encoding="utf-8")), path


def test_every_note_begins_with_its_conclusion() -> None:
    for path in (ROOT / "docs" / "notes").glob("*.md"):
        if path.stem != "index":
            first = path.read_text(encoding="utf-8").splitlines()[:4]
            assert any(line.startswith("**Conclusion.**") for line in first), path


def test_pages_that_sources_and_reports_name_exist() -> None:
    named = [
        (path, result)
        for folder in ("src", "workflow", "config", "benchmarks")
        for path in (ROOT / folder).rglob("*")
        if path.suffix in {".py", ".yaml", ".smk", ".rst", ".md"}
        for result in re.findall(r"\bdocs/[\w/-]+\.md", path.read_text(encoding="utf-8"))
    ]
    missing = [(path, name) for path, name in named if not (ROOT / name).exists()]
    assert not missing


def test_files_and_modules_that_pages_name_exist() -> None:
    pages = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md"), ROOT / "config" / "README.md"]
    for path in [path for path in pages if path.name != "CHANGELOG.md"]:
        text = path.read_text(encoding="utf-8")
        named = re.findall(rf"(?<![\w/.])(?:{FOLDERS})/[\w./-]+\.(?:py|yaml|md|smk|json|svg)", text)
        named += [f"{name.replace('.', '/')}.py" for name in re.findall(r"-m (bench[\w.]+)", text)]
        missing = [name for name in named if not (ROOT / name).exists()]
        assert not missing, path
        for name in re.findall(r"`(puckbench(?!\.sif)(?:\.\w+)+)`", text):
            pkgutil.resolve_name(name)


def test_links_of_the_pages_outside_the_site_lead_somewhere() -> None:
    for name in ("README.md", "CONTRIBUTING.md", "config/README.md"):
        for target in re.findall(r"\]\(([\w./-]+)(?:#[\w-]+)?\)", page(name)):
            assert ((ROOT / name).parent / target).exists(), (name, target)
