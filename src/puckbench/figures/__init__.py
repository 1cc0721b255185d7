"""Figures of the benchmark: each one a function from tidy tables to a matplotlib Figure."""
