"""The former place of stages, whose names other distributions import from here."""
