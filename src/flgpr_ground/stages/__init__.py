"""Rival stages: what recipes may name beside the stages of the package."""
