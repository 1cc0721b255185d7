"""Needs of the thesis's tables and figures."""
