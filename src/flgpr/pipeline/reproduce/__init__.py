"""The four papers' experiments, run anew on simulated lanes."""
