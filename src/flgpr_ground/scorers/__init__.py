"""Scores of rival estimators, as :mod:`flgpr.detect.scorers` has those of the package."""
