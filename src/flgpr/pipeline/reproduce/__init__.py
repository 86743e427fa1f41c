"""The papers' experiments, run again on simulated lanes: one module per paper, one page each."""
