"""Point-cloud codecs behind one interface: encode(points, rate) -> bytes, decode(bytes) -> points."""
