"""The HTML report of a run, and comparison with reference results."""
