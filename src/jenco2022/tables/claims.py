from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from jenco2022.claims.catalogue import CLAIMS, Claim
from jenco2022.claims.evidence import Evidence
from jenco2022.claims.verdicts import UNTESTED, needs_text, results_text, verdict
from jenco2022.published_rates import median_rows
from puckbench.metrics.table_registry import TABLES

if TYPE_CHECKING:
    import pandas as pd


@TABLES.register(
    "claims", title="The thesis's claims, one by one", category="Claims", needs=("claims",)
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
    """The 14 claims of the thesis, with verdicts and measurements of this run.

    ``thesis_verdict`` is the verdict on the thesis's medians. Rules are in docs/notes/claims.md.

    Parameters
    ----------
    datasets, codecs, stand_ins
        As in `Evidence`.
    """
    import pandas as pd

    tables = (metrics, clouds, residual_statistics, thesis_numbers, incidence_effect)
    evidence = Evidence(*tables, datasets, codecs, stand_ins or {})
    published = thesis_evidence()
    rows = [_row(number, claim, evidence, published) for number, claim in enumerate(CLAIMS, 1)]
    return pd.DataFrame(rows)


def thesis_evidence() -> Evidence:
    """Return the medians of thesis Figure 6.5 in the form of a run's results."""
    import pandas as pd

    table = pd.DataFrame(list(median_rows())).astype({"bpp": float})
    datasets, codecs = (list(dict.fromkeys(table[name])) for name in ("dataset", "codec"))
    return Evidence(table, datasets={name: name for name in datasets},
                    codecs={name: name for name in codecs}, of_medians=True)  # fmt: skip


def _row(number: int, claim: Claim, evidence: Evidence, published: Evidence) -> dict[str, object]:
    parts = claim.test(evidence)
    thesis_verdict = verdict(claim.test(published))
    return {
        "number": number,
        "section": claim.section,
        "claim": claim.words,
        "verdict": verdict(parts),
        "here": results_text(parts),
        "not_tested": needs_text(parts),
        "thesis": claim.thesis,
        "thesis_verdict": "" if thesis_verdict.startswith(UNTESTED) else thesis_verdict,
        "figure": ", ".join(claim.figures),
        "thesis_figure": claim.thesis_figure,
    }
