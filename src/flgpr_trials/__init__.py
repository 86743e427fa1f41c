"""Trials: plans of tests, registers that only grow, sealed truths and the pages of a trial.

It enters flgpr by the entry points of the groups ``flgpr.commands`` and ``flgpr.trials``; ``flgpr``
does not rest on it. Its public names are those of :mod:`flgpr.trials`.
"""
