"""The HTML report of a run, and the comparison of a run with reference results."""
