"""puckbench: a reproducible benchmark of point-cloud compression on virtual VLP-16 scans."""

__version__ = "0.1.0"
