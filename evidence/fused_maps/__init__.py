"""Lanes, looks, maps and experiments of `fused_variants.py`."""
