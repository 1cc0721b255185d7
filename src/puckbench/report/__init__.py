"""The report: one HTML file with a run's figures, tables, curves and clouds, for any browser."""
