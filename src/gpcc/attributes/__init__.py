"""Attributes of G-PCC (ISO/IEC 23090-9): predicting and lifting transforms, RAHT."""
