"""Small scenes as input of a full-wave solver."""
