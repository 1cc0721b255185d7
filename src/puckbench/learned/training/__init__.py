"""Training of learned codecs: settings, examples, loop, validation."""
