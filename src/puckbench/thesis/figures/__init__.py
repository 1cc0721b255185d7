"""Figures of the thesis and of its comparison with a run."""
