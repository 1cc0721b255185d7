"""Basic modules that all packages use: errors, random generators, files, threads, compilation."""
