"""From geometry or returns to clouds that codecs take: sampling, cropping, normals, scaling."""
