"""Codecs that are programs of others, run under limits."""
