"""Results of steps on disk: streams, rows and tables."""
