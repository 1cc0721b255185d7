"""Conditions on a plan for the production of tables and figures."""
