"""The claims of the thesis; docs/notes/claims.md has the rules by which they are tested."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from puckbench.thesis.claims import cloud_statistics, rate_distortion, sensor_errors
from puckbench.thesis.claims.evidence import Evidence
from puckbench.thesis.claims.verdicts import Part


@dataclass(frozen=True)
class Claim:
    """A claim, its section and numbers in the thesis, its test, and figures that show it."""

    words: str
    section: str
    thesis: str
    test: Callable[[Evidence], list[Part]]
    figures: tuple[str, ...]
    thesis_figure: str = ""


_CD = "median CD(plane) on CAPOD, first to last rate"

CLAIMS: tuple[Claim, ...] = (
    Claim(
        "Real residuals have mean 0.00 and standard deviation 0.014 m, walls and floors alike.",
        "5.1.3",
        "mean 0.0007 m, std 0.0138 m",
        sensor_errors.real_spread,
        ("fig_5_10",),
        "5.10",
    ),
    Claim(
        "The HDL-64E's default noise is far too wide for a VLP-16.",
        "5.5",
        "std 0.0652 m against 0.0138 m; earth mover's distance 0.0399 m, VLP-16 0.0044 m",
        sensor_errors.default_noise_too_wide,
        ("fig_5_18", "model_verdict"),
        "5.18",
    ),
    Claim(
        "Modelling beam divergence changes next to nothing, at 5 m and at 30 m.",
        "5.5",
        "std 0.0186 m without, 0.0198 m with it; from 30 m 0.0163 and 0.0171 m",
        sensor_errors.divergence_is_negligible,
        ("fig_5_18", "fig_5_19"),
        "5.19",
    ),
    Claim(
        "A variance that rises with incidence does not raise the residuals as the real floor does.",
        "5.5",
        "real std 0.0118 m in the first bin of incidence, 0.0246 m in the last",
        sensor_errors.incidence_not_modelled,
        ("fig_5_20", "fig_5_21"),
        "5.20",
    ),
    Claim(
        "The noise depends neither on the distance from 1 to 5 m nor on the laser.",
        "5.1.3",
        "",
        sensor_errors.no_dependence_on_distance_or_laser,
        ("fig_5_11", "fig_5_12", "fig_5_13", "fig_5_14"),
        "5.11-5.14",
    ),
    Claim(
        "CD improves with the rate for all codecs, and all but Draco level off.",
        "6.2",
        f"{_CD}: Draco 433 to 0.022, G-PCC 6.2 to 0.29, PCGCv1 2.8 to 7.3, PCGCv2 3.7 to 0.40",
        rate_distortion.improves_and_levels_off,
        ("beside_thesis", "fig_6_5", "gpcc_rounding"),
        "6.5",
    ),
    Claim(
        "At low rates the learned codecs match or beat the classical ones.",
        "6.2",
        "median CD(plane) on CAPOD at r1: Draco 433, G-PCC 6.2, PCGCv1 2.8, PCGCv2 3.7",
        rate_distortion.learned_match_at_low_rates,
        ("fig_6_6",),
        "6.5, 6.6",
    ),
    Claim(
        "In the Hausdorff distance the learned codecs lag, more so on scans.",
        "6.2",
        "squared HD(plane) at the last rate: G-PCC 2.7 everywhere; PCGCv2 44 on CAPOD, 1660 and "
        "648 on scans; PCGCv1 3560, 3410 and 2600",
        rate_distortion.learned_lag_in_hausdorff,
        ("fig_6_7",),
        "6.7",
    ),
    Claim(
        "Times grow with the rate for Draco, G-PCC and PCGCv1, hardly for PCGCv2; G-PCC's most.",
        "6.2",
        "Draco 0.2 to 2 s, G-PCC 1 to 18 s, PCGCv1 14 to 50 s, PCGCv2 11 to 17 s",
        rate_distortion.time_grows,
        ("fig_6_5", "fig_6_8", "fig_6_9"),
        "6.8, 6.9",
    ),
    Claim(
        "CD behaves alike on S3DIS, its scans and CAPOD.",
        "6.2",
        "median CD(plane) at r4 on CAPOD, S3DIS, clean and noisy scans: G-PCC 0.36, 0.34, 0.35, "
        "0.32; PCGCv2 0.50, 1.45, 0.78, 1.5",
        rate_distortion.alike_on_all_data,
        ("beside_thesis", "fig_6_5"),
        "6.5",
    ),
    Claim(
        "G-PCC beats the learned codecs once the bitrate rises.",
        "6.2",
        "",
        rate_distortion.gpcc_wins_at_high_rates,
        ("fig_6_6",),
        "6.6",
    ),
    Claim(
        "On scans Draco's curve lies at more bits, because Draco keeps duplicate points.",
        "6.2",
        "Draco from 0.016 to 8 bpp on CAPOD, 2.8 to 17 and 3.2 to 22 bpp on scans",
        cloud_statistics.draco_shifted_by_duplicates,
        ("fig_6_6",),
        "6.6",
    ),
    Claim(
        "The elongation of a room has no visible effect.",
        "6.1.6",
        "",
        cloud_statistics.elongation_has_no_effect,
        ("elongation",),
        "",
    ),
    Claim(
        "Scanned clouds have a narrower spread of point counts and a higher median than raw rooms.",
        "6.2",
        "quartiles 0.575 and 1.085 million around 0.79 raw; 1.0 and 1.265 around 1.19 clean; 0.91 "
        "and 1.145 around 1.04 noisy",
        cloud_statistics.scans_have_alike_counts,
        ("fig_6_4",),
        "6.4",
    ),
)
"""In the order of docs/notes/claims.md; claims are numbered from 1."""
