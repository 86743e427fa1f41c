"""A detector of one's own to begin with: a module that runs as it is."""

from __future__ import annotations

from pathlib import Path

from flgpr.door import read_named
from flgpr.store import write_whole
from flgpr.store.outputs import log_finished
from flgpr_ground.ground import packaged_text


def write_template(folder: str | Path) -> Path:
    """Write a detector of one's own to begin with.

    Parameters
    ----------
    folder : str or path
        Takes the file; it is made if it is not there.

    Returns
    -------
    Path
        ``my_detector.py``, which begins with the command that runs it.

    Raises
    ------
    FileExistsError
        If the file is there with another content.
    """
    text = packaged_text("templates/my_detector.py")
    path = Path(folder) / "my_detector.py"
    if path.exists():
        if read_named(path) != text.encode():
            raise FileExistsError(f"folder must not have a {path.name} of one's own, got {path}")
        log_finished(path.resolve())
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text)
    return path
