"""Parametric objects: the function of a class makes an item from a modeller and a member number."""
