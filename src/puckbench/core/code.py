"""Names of modules and packages on which the results of several jobs depend.

A job runs again when the code that makes its results changes (`puckbench.steps.fingerprints`).
The module of each job or plug-in lists this code by name in its constant ``CODE``:

* a module stands for its own file and for what its own ``CODE`` lists;
* a package stands for all files directly in its folder, except plug-ins;
* a package with ``.*`` at the end stands for all files in and below its folder.

The package pointkit always counts, and is not listed.
"""

from __future__ import annotations

CLOUD_FILES = (
    *("cloud_files.clouds", "cloud_files.content", "cloud_files.descriptions", "cloud_files.ply"),
    *("puckbench.core.archives", "cloud_files.missing_returns", "cloud_files.point_columns"),
)
"""Code that reads and writes clouds on disk."""
MESH_FILES = (*CLOUD_FILES, "cloud_files.meshes", "cloud_files.meshes.ply")
"""Code that reads and writes scenes on disk, which are meshes or clouds."""
SENSOR = ("virtual_lidar", "virtual_lidar.errors")
"""Code of the virtual sensor, without its error models, which are plug-ins."""
CODEC = (
    *("puckbench.codecs.base", "puckbench.steps.coding"),
    *("puckbench.results.curves", "puckbench.results.row_files"),
)
"""Code that calls codecs, and that reads and writes archives of streams and rows of results."""
STATISTICS = (
    *("puckbench.metrics.bjontegaard", "puckbench.metrics.coordinate_frames"),
    *("puckbench.metrics.interpolation", "puckbench.metrics.lossless", "puckbench.metrics.peaks"),
    *("puckbench.metrics.statistics", "puckbench.metrics.timing"),
)
"""Code that computes statistics of results."""
FIGURES = (
    *(*STATISTICS, "puckbench.results.columns", "puckbench.figures", "virtual_lidar.errors"),
    *("puckbench.codecs.old_contract", "puckbench.codecs.rates"),
)
"""Code that all figures share."""
TABLES = (*FIGURES, "puckbench.tables")
"""Code that all tables share, with that of their columns and file formats."""
