"""Conversion of a configuration to a plan of jobs."""
