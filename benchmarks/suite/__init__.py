"""What flgpr's work costs: an asv suite of times, peak memory and latency.

``asv run --python=same --quick`` in ``benchmarks/`` runs it once in the installed environment;
``asv continuous --interleave-rounds main HEAD`` compares two commits.
"""
