"""Parametric models of objects: the function of a class makes its variant number `member`."""
