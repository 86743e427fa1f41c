"""Make the packaged tables of signatures anew, and the manifest that lists them with their digests.

``python evidence/make_tables.py WORK [BODY ...]`` computes all packaged bodies' tables, or those named, on two
processes; WORK keeps what is done, and the same call goes on there. It takes about an hour. The same nodes give the
same files on equal processors with equal versions of the libraries.
"""

from __future__ import annotations

import argparse
import json
from hashlib import sha256
from pathlib import Path

import flgpr.simulate.bodies.signature
from flgpr.simulate.bodies.signature import build_table, load_body, packaged_bodies, save_table

TABLES = Path(flgpr.simulate.bodies.signature.__file__).parent / "tables"


def write_manifest() -> None:
    files = {
        path.name: {"bytes": path.stat().st_size, "sha256": sha256(path.read_bytes()).hexdigest()}
        for path in sorted(TABLES.glob("*.npz"))
    }
    about = {"made_by": "python evidence/make_tables.py WORK", "files": files}
    (TABLES / "manifest.json").write_text(json.dumps(about, indent=1) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", type=Path, help="folder that keeps what is done")
    parser.add_argument("bodies", nargs="*", help="packaged bodies; default all")
    told = parser.parse_args()
    for name in told.bodies or packaged_bodies():
        table = build_table(load_body(name), told.work, workers=2)
        print(name, save_table(table, TABLES / f"{name}.npz"), flush=True)
    write_manifest()


if __name__ == "__main__":
    main()
