"""Point-cloud codecs with one interface: encode points to a byte string, and decode it."""
