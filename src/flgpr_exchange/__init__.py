"""Files of other programs: makers' recorders, recordings, full-wave solvers and maps.

The instrument ``flgpr`` finds what is here by entry points: readers (``flgpr.formats``), writers
(``flgpr.exports``), engines of simulation (``flgpr.engines``) and commands (``flgpr.commands``).
"""
