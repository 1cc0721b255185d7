"""Parametric models of objects; the function of each class makes its member with a number."""
