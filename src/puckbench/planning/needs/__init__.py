"""Conditions under which a plan can make a table or figure."""
