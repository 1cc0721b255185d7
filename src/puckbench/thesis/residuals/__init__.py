"""The residual study of thesis chapter 5: virtual walls and floors, statistics, comparisons."""
