"""Figures drawn from the tables and clouds of a run."""
