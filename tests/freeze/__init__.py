"""What must not change while the code is reorganised: results, files, commands and public names.

``PYTHONPATH=src:tests python -m freeze`` writes the frozen tables anew, see ``freeze.__main__``.
"""
