"""Health of a run: what its data and poses show of a radar that is at fault, and what can be done."""
