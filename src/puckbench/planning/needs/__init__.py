"""Needs: named conditions that a run must meet for a table or figure to be made."""
