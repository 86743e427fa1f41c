"""The map of worlds: on which lanes mines are found."""
