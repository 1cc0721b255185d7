"""Jenco's thesis of 2022 beside a run of puckbench: claims with tests, published numbers, figures.

The package consists of plug-ins, which puckbench finds by their entry point. In Python, `CLAIMS`
are the claims; each has a `test` of an `Evidence`, the tables of a run. `verdict` and
`results_text` put what a test found into words. `medians_of_thesis` returns the published medians
as a table, `thesis_evidence` as the evidence of the thesis's own results.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from jenco2022.claims.catalogue import CLAIMS as CLAIMS
    from jenco2022.claims.catalogue import Claim as Claim
    from jenco2022.claims.evidence import Evidence as Evidence
    from jenco2022.claims.evidence import thesis_evidence as thesis_evidence
    from jenco2022.claims.verdicts import Part as Part
    from jenco2022.claims.verdicts import results_text as results_text
    from jenco2022.claims.verdicts import verdict as verdict
    from jenco2022.published import medians_of_thesis as medians_of_thesis

__getattr__, __dir__, __all__ = lazy(
    __name__,
    **{
        "claims.catalogue": ("CLAIMS", "Claim"),
        "claims.evidence": ("Evidence", "thesis_evidence"),
        "claims.verdicts": ("Part", "results_text", "verdict"),
        "published": ("medians_of_thesis",),
    },
)
