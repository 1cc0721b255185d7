"""Point-cloud codecs behind one interface: points in, one byte string out, and back."""
