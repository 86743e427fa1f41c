"""Scores of trained estimators from named arrays, a few settings, and plain arithmetic.

An estimator is trained by the library that it comes from. What its scores depend on is then
extracted: arrays of numbers, and settings that JSON can hold. Scores are computed from these alone.
So a model file needs no library to be read, holds nothing that could run, and scores the same
whichever version of a library trained it.
"""
