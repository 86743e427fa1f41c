"""The study of Cosgrove, Milanfar and Kositsky 2004 on simulated lanes."""
