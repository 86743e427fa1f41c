"""The study of flsar2004 on simulated lanes."""
