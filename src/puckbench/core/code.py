"""Names of the code that results of several jobs depend on.

The module of a job or plug-in lists in its constant ``CODE`` what its results depend on besides
pointkit, on which all do (`puckbench.planning.fingerprints`): modules, of which only their own file
counts and what their ``CODE`` names; rooms of puckbench and other packages of the repository, with
all files directly in their folder except plug-ins; and, with ``.*`` at the end, packages with all
that is below.
"""

from __future__ import annotations

CLOUD_FILES = (
    *("cloud_files.clouds", "cloud_files.content", "cloud_files.descriptions", "cloud_files.ply"),
    *("puckbench.core.archives", "cloud_files.missing_returns", "cloud_files.point_columns"),
)
"""Clouds on disk, as the jobs of a run write and read them."""
MESH_FILES = (*CLOUD_FILES, "cloud_files.meshes", "cloud_files.meshes.ply")
"""Scenes on disk: meshes, or clouds."""
SENSOR = ("virtual_lidar", "virtual_lidar.errors")
"""The virtual sensor, but for its error models."""
CODEC = ("puckbench.codecs.base", "puckbench.jobs.codec_jobs", "puckbench.jobs.curve_files")
"""Calls of a codec, and archives of its streams."""
RECORDINGS = (
    *("puckbench.recordings", "puckbench.datasets.recordings", "puck.records"),
    *("puck.recordings", "puckbench.codecs.registry", "cloud_files.missing_returns"),
    "cloud_files.point_columns",
)
"""Recordings of real sensors."""
STATISTICS = (
    *("puckbench.metrics.bjontegaard", "puckbench.metrics.coordinate_frames"),
    *("puckbench.metrics.interpolation", "puckbench.metrics.lossless", "puckbench.metrics.peaks"),
    *("puckbench.metrics.statistics", "puckbench.metrics.timing"),
)
"""Statistics of results."""
FIGURES = (*(*STATISTICS, "puckbench.figures", "puckbench.codecs.facts", "virtual_lidar.errors"),)
"""Figures, but for the one that is drawn."""
TABLES = (
    *(*FIGURES, "puckbench.metrics.tables", "puckbench.report", "puckbench.jobs.table_files"),
)
"""Tables, with their columns, and their formats."""
