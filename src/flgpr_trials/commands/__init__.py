"""The commands ``flgpr seal`` and ``flgpr plan``, and what scores ask of a trial."""
