"""The table of the thesis's claims: what it says, what was measured, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from puckbench.thesis.claims.evidence import Evidence
from puckbench.thesis.claims.parts import UNTESTED, told, verdict, wanted
from puckbench.thesis.claims.registry import CLAIMS, Claim
from puckbench.thesis.published_rates import median_rows


def claims(
    metrics: pd.DataFrame | None = None,
    clouds: pd.DataFrame | None = None,
    residual_statistics: pd.DataFrame | None = None,
    thesis_numbers: pd.DataFrame | None = None,
    incidence_effect: pd.DataFrame | None = None,
    *,
    datasets: Mapping[str, str],
    codecs: Mapping[str, str],
    stand_ins: Mapping[str, str] | None = None,
) -> pd.DataFrame:
    """One row for each claim, tested on those tables of a run that there are.

    datasets: data set -> what it is; codecs: role -> codec, stand_ins: role -> a codec that changes
    the one of that role, see `roles`. Columns: ``number``,
    ``section`` and ``claim`` of the thesis, ``verdict`` (see `puckbench.thesis.claims.parts`),
    ``here``: each part tested, whether it holds, and our numbers; ``not_tested``: what the other
    parts need; ``thesis``: its own numbers; ``thesis_verdict``: the verdict of the same rule on
    the thesis's own medians, where they are enough for it; ``figure``: ours, by name;
    ``thesis_figure``: the thesis's.
    """
    found = Evidence(
        metrics,
        clouds,
        residual_statistics,
        thesis_numbers,
        incidence_effect,
        datasets=datasets,
        codecs=codecs,
        stand_ins=stand_ins or {},
    )
    own = thesis_evidence()
    rows = [_row(number, claim, found, own) for number, claim in enumerate(CLAIMS, 1)]
    return pd.DataFrame(rows)


def thesis_evidence() -> Evidence:
    """The thesis's own medians of Figure 6.5 as if they were a run's."""
    table = pd.DataFrame(list(median_rows())).astype({"bpp": float})
    datasets, codecs = (list(dict.fromkeys(table[name])) for name in ("dataset", "codec"))
    return Evidence(table, datasets={name: name for name in datasets},
                    codecs={name: name for name in codecs})  # fmt: skip


def _row(number: int, claim: Claim, found: Evidence, own: Evidence) -> dict[str, object]:
    parts = claim.test(found)
    of_thesis = verdict(claim.test(own))
    return {
        "number": number,
        "section": claim.section,
        "claim": claim.words,
        "verdict": verdict(parts),
        "here": told(parts),
        "not_tested": wanted(parts),
        "thesis": claim.thesis,
        "thesis_verdict": "" if of_thesis.startswith(UNTESTED) else of_thesis,
        "figure": ", ".join(claim.figures),
        "thesis_figure": claim.thesis_figure,
    }
