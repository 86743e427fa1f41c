"""Detection scan by scan, while the vehicle drives."""
