"""Parametric objects: a function for each class makes an item of any size from a modeller and a
member number.
"""
