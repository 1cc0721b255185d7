"""What codecs share: binary arithmetic coding, context mixing, numbers and bytes of a stream."""
