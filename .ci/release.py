"""What a release needs of this tree.

``python .ci/release.py notes TAG`` prints the section of CHANGELOG.md for a version, as release notes.
``python .ci/release.py links ADDRESS TAG`` makes the links of README.md absolute, in place: its relative ones lead
nowhere on a page of a package index. ADDRESS is that of the repository the release is made from.

Both refuse a tag that does not belong to this tree.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PICTURES = (".png", ".gif", ".svg", ".jpg")


def main() -> None:
    """Do what the command line asks for."""
    match sys.argv[1:]:
        case ["notes", tag]:
            print(release_notes(ROOT, tag))
        case ["links", address, tag]:
            checked_version(ROOT, tag)
            readme = ROOT / "README.md"
            text = absolute_links(readme.read_text(encoding="utf-8"), address, tag)
            readme.write_text(text, encoding="utf-8")
        case _:
            raise SystemExit(__doc__)


def checked_version(root: Path, tag: str) -> str:
    """Return the version of a tag, such as v0.1.0; another one than that of the files is refused."""
    version = tag.removeprefix("v")
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (root / "CITATION.cff").read_text(encoding="utf-8")
    [cited] = re.findall(r"^version: (\S+)$", citation, re.MULTILINE)
    for file, stated in (("pyproject.toml", project["version"]), ("CITATION.cff", cited)):
        if stated != version:
            raise ValueError(f"version of {file} must be that of the tag {tag}, got {stated}")
    return version


def release_notes(root: Path, tag: str) -> str:
    """Return the section of the changelog for a tag, each entry on one line.

    Code hosts show every end of a line in release notes.
    """
    version = checked_version(root, tag)
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = {}
    for section in re.split(r"^## ", changelog, flags=re.MULTILINE)[1:]:
        heading, _, body = section.partition("\n")
        name, _, date = heading.partition(" ")
        sections[name] = (date, body)
    if version not in sections:
        raise ValueError(
            f"CHANGELOG.md must have a section for {version}, got {', '.join(sections)}"
        )
    date, body = sections[version]
    if not re.fullmatch(r"\(\d{4}-\d{2}-\d{2}\)", date):
        raise ValueError(f"section {version} of CHANGELOG.md must have its date, got {date!r}")
    return re.sub(r"\n +", " ", body).strip()


def absolute_links(text: str, address: str, tag: str) -> str:
    """Return a text whose relative links lead into the repository of an address, at a tag."""

    def absolute(link: re.Match[str]) -> str:
        target = link[1]
        if "://" in target or target.startswith("#"):
            return link[0]
        view = "raw" if target.endswith(PICTURES) else "blob"
        return f"]({address}/{view}/{tag}/{target})"

    return re.sub(r"\]\(([^)\s]+)\)", absolute, text)


if __name__ == "__main__":
    main()
