"""Claims, published numbers and figures of Jenco's thesis of 2022, for comparison with a run.

The package consists of plug-ins of puckbench, which finds them by their entry point. The Python
interface has these parts:

`CLAIMS` are the claims of the thesis. The function `test` of a claim takes an `Evidence`, which
holds tables of a run, and returns a `Part` for each part of the claim. `verdict` and `results_text`
turn these results into words. `medians_of_thesis` returns the published medians as a table, and
`thesis_evidence` returns the thesis's own results as an `Evidence`.
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
