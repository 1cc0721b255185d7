"""What learned codecs have in common: weights, entropy models, training, and the codec."""
