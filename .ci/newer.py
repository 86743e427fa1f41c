"""Which libraries that flgpr needs have other versions in this environment than a list of constraints.

``python .ci/newer.py constraints.txt`` prints one a line. `make newest` tests them; without any, `make test` has run
with the newest versions there are.
"""

import re
import sys
from collections.abc import Iterable, Iterator
from importlib.metadata import requires, version
from pathlib import Path


def newer(requirements: Iterable[str], constraints: str) -> Iterator[str]:
    """Yield ``name==version`` of every requirement of the core whose version is not in the constraints."""
    tested = {plain(line) for line in constraints.splitlines()}
    for requirement in requirements:
        if "extra ==" not in requirement:
            name = re.split(r"[^\w.-]", requirement)[0]
            installed = f"{name}=={version(name)}"
            if plain(installed) not in tested:
                yield installed


def plain(text: str) -> str:
    """Return a name with its version in the one way of spelling that all tools understand."""
    return re.sub(r"[-_]+", "-", text.strip()).lower()


if __name__ == "__main__":
    for line in newer(requires("flgpr") or (), Path(sys.argv[1]).read_text("utf-8")):
        print(line)
