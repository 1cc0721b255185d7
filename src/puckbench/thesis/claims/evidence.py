"""The tables of a run on which claims are tested, and which data set or codec has which role."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from puckbench.figures.binning import ordered_rates
from puckbench.figures.plot_styles import codec_style
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    import pandas as pd

MEASURED = ("bpp", "cd_plane", "hausdorff_sq_plane", "encode_s", "decode_s")
LEAST_RATES = 4
"""Of a curve that has an upper and a lower half, and values between its points."""
LEAST_COMPARED = 3
"""Rates at which two curves of a data set are compared at equal bits: one or two say nothing of a
half of the rates, nor of a median."""
LEAST_CLOUDS = 4
"""Of all data sets that a part is tested on: as many as quartiles need."""
LEAST_CALLS = 5
"""Timed calls for each rate and data set, over clouds and repetitions, for a median of times."""
LEAST_REPEATS = 3
"""Timed calls of one cloud at one rate, for them to count, where other jobs ran beside them: of
three the median is not the one that was disturbed. Alone on the machine, one counts."""


@dataclass(frozen=True)
class Evidence:
    """Tables of a run, and the roles of its data sets and codecs.

    Parameters
    ----------
    metrics, clouds, residual_statistics, thesis_numbers, incidence_effect
        Tables of the same names in ``results/tables``; None where there is none.
    datasets
        Data set -> its role, one of `roles.DATASETS`.
    codecs
        Role -> the codec of the run that has it.
    stand_ins
        Role -> a codec that changes the one of this role, and does not have it.
    of_medians
        Whether rows are medians over more clouds than can be counted here.
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
        """The same tables, with a changed codec in place of each of the thesis's that is absent."""
        return replace(self, codecs={**self.stand_ins, **self.codecs})

    def stand_in(self, role: str) -> str:
        """Title of the codec in place of an absent one; empty where the thesis's own is there."""
        codec = self.codecs.get(role)
        return codec_style(codec).title if codec and codec == self.stand_ins.get(role) else ""

    def named(self, *roles: str) -> list[str]:
        """The data sets with results that have one of these roles."""
        return [name for name, role in self.datasets.items() if role in roles and name in self.has]

    @cached_property
    def has(self) -> set[str]:
        """Data sets with results."""
        return set() if self.metrics is None else set(self.metrics["dataset"])

    @cached_property
    def medians(self) -> pd.DataFrame:
        """Medians over clouds, by data set, role of the codec, and rate.

        Columns: ``dataset``, ``codec`` (the role), ``rate``, ``number`` (the rate's place) and
        those of `MEASURED`, missing ones as nan.
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
        """Clouds of some data sets that every one of some codecs, by their roles, has coded."""
        if self.metrics is None:
            return 0
        rows = self.metrics[self.metrics["dataset"].isin(list(datasets))]
        own = rows["dataset"] + "/" + rows["cloud"]
        coded = [set(own[rows["codec"] == self.codecs.get(codec)]) for codec in codecs]
        return len(set.intersection(*coded))

    def enough_clouds(self, datasets: Iterable[str], *codecs: str) -> bool:
        """Whether data sets have `LEAST_CLOUDS` of some codecs together."""
        return self.of_medians or self.clouds_of(datasets, *codecs) >= LEAST_CLOUDS

    def calls(self, codec: str) -> int:
        """Timed calls of a codec that count, for each rate and data set, at least.

        Those of a cloud count that were repeated (`LEAST_REPEATS`), or were alone on the machine.
        """
        if self.metrics is None:
            return 0
        rows = self.metrics[self.metrics["codec"] == self.codecs.get(codec)]
        if rows.empty:
            return 0
        rows = rows.reindex(columns=["dataset", "rate", "repeats", "timed_alone"])
        repeats = rows["repeats"].fillna(1)
        alone = rows["timed_alone"].eq(True)
        counted = repeats.where(alone | (repeats >= LEAST_REPEATS), 0)
        return int(counted.groupby([rows["dataset"], rows["rate"]]).sum().min())

    def rates(self, dataset: str, codec: str, column: str) -> Floats:
        """Medians of a column from the first to the last rate.

        Parameters
        ----------
        dataset
            Name of a data set.
        codec
            A role.
        column
            One of `MEASURED`.

        Returns
        -------
        Floats
            (n,); rates without a value are left out.
        """
        rows = self.medians
        rows = rows[(rows["dataset"] == dataset) & (rows["codec"] == codec)]
        return rows.sort_values("number")[column].dropna().to_numpy(dtype=float)

    def at_equal_rate(self, dataset: str, tested: str, base: str, column: str) -> pd.DataFrame:
        """Ratios of a codec's medians to another's at the same bits per point.

        The base's values are interpolated between the logarithms of its rates. Nothing is
        extrapolated. Curves of fewer than `LEAST_RATES` rates have no value, nor have those with
        fewer than `LEAST_COMPARED` of the tested codec's rates within the base's range.

        Parameters
        ----------
        dataset
            Name of a data set.
        tested, base
            Roles.
        column
            One of `MEASURED`.

        Returns
        -------
        pd.DataFrame
            Columns ``bpp`` and ``ratio``, by rising ``bpp``.
        """
        import pandas as pd

        one, other = (self._curve(dataset, codec, column) for codec in (tested, base))
        nothing = pd.DataFrame({"bpp": [], "ratio": []}, dtype=float)
        if min(len(one), len(other)) < LEAST_RATES:
            return nothing
        one = one[one["bpp"].between(other["bpp"].iloc[0], other["bpp"].iloc[-1])]
        if len(one) < LEAST_COMPARED:
            return nothing
        logs = np.log(other.to_numpy(dtype=float))
        between = np.interp(np.log(one["bpp"]), logs[:, 0], logs[:, 1])
        return pd.DataFrame({"bpp": one["bpp"], "ratio": one[column] / np.exp(between)})

    def _curve(self, dataset: str, codec: str, column: str) -> pd.DataFrame:
        """Positive medians of bpp and a column, by rising bpp."""
        rows = self.medians
        rows = rows[(rows["dataset"] == dataset) & (rows["codec"] == codec)]
        rows = rows[["bpp", column]].dropna()
        return rows[(rows > 0).all(axis=1)].sort_values("bpp")
