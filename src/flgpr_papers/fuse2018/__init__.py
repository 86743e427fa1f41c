"""The study of Fuse et al. 2018 on simulated lanes."""
