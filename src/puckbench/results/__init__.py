"""Results of steps: streams and rows on disk, and what the columns of rows contain."""
