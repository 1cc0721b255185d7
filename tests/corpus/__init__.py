"""Small odd files of every format, each with the points that it holds or the line that refuses it.

``python -m tests.corpus FOLDER`` writes them all.
"""
