from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from jenco2022.claims.catalogue import CLAIMS, Claim
from jenco2022.claims.evidence import Evidence, thesis_evidence
from jenco2022.claims.rate_distortion import time_grows
from jenco2022.claims.verdicts import UNTESTED, needs_text, results_text, verdict
from jenco2022.published import GPCC, GPCC_AS_RUN, ROOMS, SAMPLED, medians_of_thesis
from puckbench.tables.registry import TABLES

if TYPE_CHECKING:
    import pandas as pd

CODE = ("jenco2022.*", "virtual_lidar.residual_table", "virtual_lidar.sweep")


_COLUMNS = {
    "number": "Number",
    "section": "Section",
    "claim": "Claim",
    "here": "Here",
    "not_tested": "Not tested",
    "thesis": "Thesis",
    "thesis_verdict": "Thesis verdict",
    "figure": "Figure",
    "thesis_figure": "Thesis figure",
}
"""Columns of this table, of which other tables of the thesis have ``here`` and ``thesis``."""


@TABLES.register(
    "claims",
    title="The thesis's claims, one by one",
    category="Claims",
    needs=("claims",),
    timed={"claim": [claim.words for claim in CLAIMS if claim.test is time_grows]},
    columns=_COLUMNS,
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
    metrics, clouds, residual_statistics, thesis_numbers, incidence_effect
        Tables of the run with these names; None for a table that the run lacks.
    datasets, codecs, stand_ins
        As in `Evidence`.
    """
    import pandas as pd

    tables = (metrics, clouds, residual_statistics, thesis_numbers, incidence_effect)
    evidence = Evidence(*tables, datasets, codecs, stand_ins or {})
    published = thesis_evidence()
    rows = [_row(number, claim, evidence, published) for number, claim in enumerate(CLAIMS, 1)]
    return pd.DataFrame(rows)


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


QUANTITIES = ("cd_plane", "hausdorff_sq_plane")


@TABLES.register(
    "thesis_medians",
    title="The thesis's medians beside this run's",
    category="Claims",
    needs=("thesis_medians",),
)
def thesis_medians(
    metrics: pd.DataFrame, *, datasets: Mapping[str, str], codecs: Mapping[str, str]
) -> pd.DataFrame:
    """Medians over clouds by rate, read off thesis figure 6.5, beside the medians of this run.

    Distances are point-to-plane, in squared grid units. The thesis's values are accurate to about 5
    %. G-PCC truncates coordinates in the thesis.

    Parameters
    ----------
    metrics
        Results of the run.
    datasets, codecs
        As in `Evidence`.
    """
    import pandas as pd

    medians = Evidence(metrics, datasets=datasets, codecs=codecs).medians
    kinds = medians["dataset"].map(dict(datasets)).replace(SAMPLED, ROOMS)
    roles = medians["codec"].replace(GPCC, GPCC_AS_RUN)
    here = medians.assign(kind=kinds, role=roles, name=medians["codec"].map(dict(codecs)))
    thesis = medians_of_thesis().drop(columns=["cloud", "bpp"])
    thesis = thesis.rename(columns={"dataset": "kind", "codec": "role"})
    both = here.merge(thesis, on=["kind", "role", "rate"], suffixes=("", "_thesis"))
    return pd.concat([_rows(both, quantity) for quantity in QUANTITIES], ignore_index=True)


def _rows(both: pd.DataFrame, quantity: str) -> pd.DataFrame:
    numbers = {"thesis": both[f"{quantity}_thesis"], "here": both[quantity]}
    names = both[["dataset", "kind", "name", "rate"]].rename(columns={"name": "codec"})
    return names.assign(quantity=quantity, **numbers)
