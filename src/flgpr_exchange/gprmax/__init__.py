"""The full-wave solver gprMax, met through files: decks for it, and its results."""
