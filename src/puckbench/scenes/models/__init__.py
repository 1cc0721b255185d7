"""Parametric objects: each class has a function that makes the object with a given member
number.
"""
