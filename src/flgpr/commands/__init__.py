"""The commands: one function each, with one signature for the command line and for Python."""
