"""Names for the types of arrays."""
