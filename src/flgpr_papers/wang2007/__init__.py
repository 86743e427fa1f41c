"""The study of Wang et al. 2007 on simulated lanes."""
