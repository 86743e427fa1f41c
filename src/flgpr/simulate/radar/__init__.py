"""The radar: the sum over pairs and tones, and all that antennas and receivers add."""
