"""The proving ground: detectors side by side on lanes that every machine makes alike, and the rivals among them.

It enters flgpr by the entry points of the groups ``flgpr.commands``, ``flgpr.stages`` and
``flgpr.estimators``, as anybody's package would; ``flgpr`` does not rest on it. Its public names
are those of :mod:`flgpr.proving_ground`.
"""
