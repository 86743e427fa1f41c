"""A detector of one's own to begin with: a module that runs as it is, and the command that runs it."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from flgpr.door import read_named
from flgpr.store import write_whole
from flgpr.store.outputs import log_finished

README = """\
`flgpr benchmark run my_detector:MyDetector --quick --tier prepared` here trains and tries it.
"""


def write_template(folder: str | Path) -> list[Path]:
    """Write a detector of one's own to begin with.

    Parameters
    ----------
    folder : str or path
        Takes the files; it is made if it is not there.

    Returns
    -------
    list of Path
        ``my_detector.py``, and ``my_detector.md`` with the command.

    Raises
    ------
    FileExistsError
        If one of the files is there with another content; then none is written.
    """
    module = resources.files("flgpr_ground") / "templates" / "my_detector.py"
    texts = {"my_detector.py": module.read_text("utf-8"), "my_detector.md": README}
    home = Path(folder)
    present = [name for name in texts if (home / name).exists()]
    for name in present:
        if read_named(home / name) != texts[name].encode():
            raise FileExistsError(f"folder must not have a {name} of one's own, got {home / name}")
    if len(present) == len(texts):
        log_finished(home.resolve())
    home.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write_whole(home / name, text)
    return [home / name for name in texts]
