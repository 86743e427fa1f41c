"""Planning an array before it is built."""
