"""Small unusual files of every format, each with the expected points or error message.

``python -m tests.corpus FOLDER`` writes them all.
"""
