"""The map of worlds: on which lanes mines are found and the papers' statements hold."""
