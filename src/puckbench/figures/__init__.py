"""Figures drawn from a run's tables and clouds."""
