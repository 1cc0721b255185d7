"""Parametric models of objects; the function of an object class makes variant number `member`."""
