"""The papers' studies, run anew on simulated lanes."""
