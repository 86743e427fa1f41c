"""The commands ``flgpr benchmark``."""
