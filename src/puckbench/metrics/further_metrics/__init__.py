"""Metrics beside the usual ones, which a configuration asks for."""
