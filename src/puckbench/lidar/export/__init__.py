"""Scans and captures in the formats of other tools: PLY, PCD, LAS, LAZ, CSV, BlenSor's, packets."""

from puckbench.lidar.export.exporting import FORMATS, Source, export, read_source

__all__ = ["FORMATS", "Source", "export", "read_source"]
