"""Storage formats as codecs: LAZ, Cloudini, data packets, range images."""
