"""Encoding and decoding of G-PCC attributes: predicting and lifting transforms, and RAHT."""
