"""Foundations of all packages: errors, random generators, files, threads, compiled loops."""
