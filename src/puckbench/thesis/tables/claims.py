"""The table of the thesis's claims: what it says, what was measured, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from puckbench.metrics.table_registry import TABLES
from puckbench.thesis.claims.evidence import Evidence
from puckbench.thesis.claims.parts import UNTESTED, told, verdict, wanted
from puckbench.thesis.claims.statements import CLAIMS, Claim
from puckbench.thesis.published_rates import median_rows

if TYPE_CHECKING:
    import pandas as pd


@TABLES.register(
    "claims",
    title="The thesis's claims, one by one",
    category="Claims",
    needs=("claims",),
)
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
    """The 14 claims of the thesis, one by one: the verdict, and what was measured.

    Beside them what this run cannot tell, and the thesis's own numbers; ``thesis_verdict`` is what
    the same rule says of the thesis's own medians. Each rule is written down in
    docs/notes/claims.md. ``figure`` names the figure that shows it.

    Parameters
    ----------
    metrics, clouds, residual_statistics, thesis_numbers, incidence_effect
        Tables of a run, where there are any.
    datasets
        Data set -> what it is.
    codecs
        Role -> codec, see `puckbench.thesis.claims.roles`.
    stand_ins
        Role -> a codec that changes the one of that role.

    Returns
    -------
    pd.DataFrame
        ``number``, ``section`` and ``claim`` of the thesis, ``verdict`` (see
        `puckbench.thesis.claims.parts`), ``here``: each part tested, whether it holds, and our
        numbers and sample sizes; ``not_tested``: what the others need; ``thesis``: its own numbers;
        ``thesis_verdict``; ``figure``: ours, by name; ``thesis_figure``: the thesis's.
    """
    import pandas as pd

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
    import pandas as pd

    table = pd.DataFrame(list(median_rows())).astype({"bpp": float})
    datasets, codecs = (list(dict.fromkeys(table[name])) for name in ("dataset", "codec"))
    return Evidence(table, datasets={name: name for name in datasets},
                    codecs={name: name for name in codecs}, of_medians=True)  # fmt: skip


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
