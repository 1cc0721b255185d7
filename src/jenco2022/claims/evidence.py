from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jenco2022.published import medians_of_thesis
from pointkit.geometry.cloud import Floats
from puckbench.figures.binning import ordered_rates
from puckbench.figures.plot_styles import codec_style
from puckbench.metrics.timing import MIN_REPEATS

if TYPE_CHECKING:
    import pandas as pd

MEASURED = ("bpp", "cd_plane", "hausdorff_sq_plane", "encode_s", "decode_s")
MIN_RATES = 4
"""Smallest number of rates of a curve; each half of the curve needs a slope."""
MIN_COMMON_RATES = 3
"""Smallest number of rates at which two curves are compared at equal bits."""
MIN_CLOUDS = 4
"""Smallest number of clouds, over all data sets, for a statement; quartiles need four."""
MIN_CALLS = 5
"""Smallest number of timed calls per rate and data set, over clouds and repetitions."""


@dataclass(frozen=True)
class Evidence:
    """The tables of a run on which claims are tested, and what its data sets and codecs represent.

    A *role* is the name of one of the thesis's data sets or codecs (`jenco2022.published`), which a
    data set or codec of the run represents.

    Parameters
    ----------
    metrics, clouds, residual_statistics, thesis_numbers, incidence_effect
        The run's tables of these names; None for a table that the run lacks.
    datasets
        Roles of the run's data sets, by name; data sets without a role are ignored.
    codecs
        Names of the run's codecs, by role.
    stand_ins
        Names of codecs that modify one of the thesis's codecs, by the role of that codec. If
        `codecs` lacks a role, some tests use these codecs in its place.
    of_medians
        Whether a row of `metrics` is a median over clouds, so that one cloud suffices.
    """

    metrics: pd.DataFrame | None = None
    clouds: pd.DataFrame | None = None
    residual_statistics: pd.DataFrame | None = None
    thesis_numbers: pd.DataFrame | None = None
    incidence_effect: pd.DataFrame | None = None
    datasets: Mapping[str, str] = field(default_factory=dict)
    codecs: Mapping[str, str] = field(default_factory=dict)
    stand_ins: Mapping[str, str] = field(default_factory=dict)
    of_medians: bool = False

    def with_stand_ins(self) -> Evidence:
        """Return this evidence with a stand-in, if there is one, in each role that has no codec."""
        return replace(self, codecs={**self.stand_ins, **self.codecs})

    def stand_in(self, role: str) -> str:
        """Return the title of the codec in a role if it is a stand-in, otherwise an empty text."""
        codec = self.codecs.get(role)
        return codec_style(codec).title if codec and codec == self.stand_ins.get(role) else ""

    def with_role(self, *roles: str) -> list[str]:
        """Return the names of the data sets in `metrics` that have one of the roles."""
        return [
            name
            for name, role in self.datasets.items()
            if role in roles and name in self.measured_datasets
        ]

    @cached_property
    def measured_datasets(self) -> set[str]:
        """Names of the data sets in `metrics`."""
        return set() if self.metrics is None else set(self.metrics["dataset"])

    @cached_property
    def medians(self) -> pd.DataFrame:
        """Medians of the results over clouds, with a row for each data set, codec and rate.

        ``codec`` is the codec's role, such as ``gpcc``, and ``number`` is the index of the rate.
        """
        import pandas as pd

        columns = ["dataset", "codec", "rate", *MEASURED]
        if self.metrics is None:
            return pd.DataFrame(columns=[*columns, "number"])
        roles = {codec: role for role, codec in self.codecs.items()}
        rows = self.metrics.reindex(columns=columns).assign(
            codec=self.metrics["codec"].map(roles.get)
        )
        rows = rows[rows["dataset"].isin(self.datasets)].dropna(subset=["codec"])
        medians = rows.groupby(["dataset", "codec", "rate"], sort=False).median().reset_index()
        places = {rate: place for place, rate in enumerate(ordered_rates(set(medians["rate"])))}
        return medians.assign(number=medians["rate"].map(places))

    def clouds_of(self, datasets: Iterable[str], *codecs: str) -> int:
        """Return how many clouds of these data sets the codecs in all of these roles coded."""
        if self.metrics is None:
            return 0
        rows = self.metrics[self.metrics["dataset"].isin(list(datasets))]
        names = rows["dataset"] + "/" + rows["cloud"]
        coded = [set(names[rows["codec"] == self.codecs.get(codec)]) for codec in codecs]
        return len(set.intersection(*coded))

    def has_enough_clouds(self, datasets: Iterable[str], *codecs: str) -> bool:
        """Return whether the codecs in these roles coded enough clouds (`MIN_CLOUDS`) of the data
        sets.
        """
        return self.of_medians or self.clouds_of(datasets, *codecs) >= MIN_CLOUDS

    def calls(self, codec: str) -> int:
        """Return how often a codec was timed: the minimum over data sets and rates.

        Only calls count that were repeated `MIN_REPEATS` times or made while no other job ran.
        Claims compare only times of one codec.

        Parameters
        ----------
        codec
            Role of the codec.
        """
        if self.metrics is None:
            return 0
        rows = self.metrics[self.metrics["codec"] == self.codecs.get(codec)]
        if rows.empty:
            return 0
        rows = rows.reindex(columns=["dataset", "rate", "repeats", "timed_alone"])
        repeats = rows["repeats"].fillna(1)
        is_alone = rows["timed_alone"].eq(True)
        valid = repeats.where(is_alone | (repeats >= MIN_REPEATS), 0)
        return int(valid.groupby([rows["dataset"], rows["rate"]]).sum().min())

    def rates(self, dataset: str, codec: str, column: str) -> Floats:
        """Return medians over clouds at each rate.

        Parameters
        ----------
        dataset
            Name of the data set.
        codec
            Role of the codec.
        column
            Column of the results.

        Returns
        -------
        numpy.ndarray
            A median for each rate, (n,), from the first rate to the last; rates without values are
            left out.
        """
        rows = self.medians
        rows = rows[(rows["dataset"] == dataset) & (rows["codec"] == codec)]
        return rows.sort_values("number")[column].dropna().to_numpy(dtype=float)

    def at_equal_rate(self, dataset: str, tested: str, base: str, column: str) -> pd.DataFrame:
        """Compare two codecs at equal bits per point.

        Medians over clouds are compared. Values of `base` are interpolated linearly on log-log
        axes.

        Parameters
        ----------
        dataset
            Name of the data set.
        tested, base
            Roles of the two codecs.
        column
            Column of the results to compare.

        Returns
        -------
        DataFrame
            For each rate of `tested` within the range of `base`: ``bpp``, its bits per point, and
            ``ratio``, the value of `tested` divided by that of `base`. The table is empty if a
            curve has fewer than `MIN_RATES` rates, or if fewer than `MIN_COMMON_RATES` can be
            compared.
        """
        import pandas as pd

        curve, base_curve = (self._curve(dataset, codec, column) for codec in (tested, base))
        empty = pd.DataFrame({"bpp": [], "ratio": []}, dtype=float)
        if min(len(curve), len(base_curve)) < MIN_RATES:
            return empty
        curve = curve[curve["bpp"].between(base_curve["bpp"].iloc[0], base_curve["bpp"].iloc[-1])]
        if len(curve) < MIN_COMMON_RATES:
            return empty
        logs = np.log(base_curve.to_numpy(dtype=float))
        base_logs = np.interp(np.log(curve["bpp"]), logs[:, 0], logs[:, 1])
        return pd.DataFrame({"bpp": curve["bpp"], "ratio": curve[column] / np.exp(base_logs)})

    def _curve(self, dataset: str, codec: str, column: str) -> pd.DataFrame:
        rows = self.medians
        rows = rows[(rows["dataset"] == dataset) & (rows["codec"] == codec)]
        rows = rows[["bpp", column]].dropna()
        return rows[(rows > 0).all(axis=1)].sort_values("bpp")


def thesis_evidence() -> Evidence:
    """Return the thesis's own results, the medians of its figure 6.5, as evidence.

    The names of data sets and codecs are their roles. Bits per point are known only for the first
    and the last rate, and times are not known.
    """
    table = medians_of_thesis()
    datasets, codecs = ({name: name for name in table[key]} for key in ("dataset", "codec"))
    return Evidence(table, datasets=datasets, codecs=codecs, of_medians=True)
