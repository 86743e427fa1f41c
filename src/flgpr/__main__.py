"""Run the command line: the console script and ``python -m flgpr``."""

from __future__ import annotations

import contextlib
import os
import sys

OBEYED = {"matplotlibrc": "Matplotlib", ".numba_config.yaml": "Numba"}
"""Files that libraries look for in the working folder, and the library."""


def main() -> None:
    """Run the command line."""
    _leave_out_working_folder()
    fault = _settings_in_working_folder()
    if fault:
        print(f"error: {fault}", file=sys.stderr)
        sys.exit(2)
    if not any(argument.startswith("--scheduler") for argument in sys.argv):
        # Otherwise xarray loads Dask, if it is installed, as soon as it sees an array, which is
        # slow.
        sys.modules["dask"] = None  # type: ignore[assignment]
    try:
        from flgpr.commands.app import app
    except KeyboardInterrupt:  # no command has begun
        print("stopped", file=sys.stderr)
        sys.exit(130)
    app(prog_name="flgpr")


def _leave_out_working_folder() -> None:
    """Remove the working folder from the module search path, where ``python -m`` puts it first.

    A command may be run in a folder that somebody else made, and that could hold a ``numpy.py``.
    The folder that this package itself was found in stays.
    """
    package_folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    if not sys.flags.safe_path and sys.path and sys.path[0] not in ("", package_folder):
        with contextlib.suppress(OSError):
            if os.path.samefile(sys.path[0], "."):
                del sys.path[0]


def _settings_in_working_folder() -> str:
    """Return a message on a library that would take settings from the working folder, or "".

    Such settings run programs (Matplotlib's ``text.usetex``) and load compiled code from where they
    say (Numba's ``cache_dir``). They also change the bytes of figures.
    """
    for name, library in OBEYED.items():
        if os.path.lexists(name):
            return (
                f"the working folder must hold no settings of libraries, got {name}, "
                f"which {library} would obey: give the command in another folder"
            )
    return ""


if __name__ == "__main__":
    main()
