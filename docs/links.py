"""A check at the end of the build: every link between the built pages leads to a page and an anchor that are there."""

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class _Page(HTMLParser):
    """Anchors of a page, and where it links and takes its pictures from."""

    def __init__(self, text):
        super().__init__()
        self.anchors = set()
        self.targets = set()
        self.feed(text)

    def handle_starttag(self, _, attrs):
        """Take the attributes that matter."""
        given = dict(attrs)
        self.anchors |= {given[name] for name in ("id", "name") if given.get(name)}
        self.targets |= {given[name] for name in ("href", "src") if given.get(name)}


def broken(folder):
    """List the links of a folder of pages that lead nowhere.

    Parameters
    ----------
    folder : path
        Built pages.

    Returns
    -------
    list of str
        Page and target, one per broken link.
    """
    root = Path(folder).resolve()
    pages = {path: _Page(path.read_text(encoding="utf-8")) for path in sorted(root.rglob("*.html"))}
    wrong = []
    for path, page in pages.items():
        for target in sorted(page.targets):
            link = urlsplit(target)
            if link.scheme or link.netloc:
                continue
            there = (path.parent / unquote(link.path)).resolve() if link.path else path
            anchor = unquote(link.fragment)
            known = pages[there].anchors if there in pages else set()
            if not there.exists() or (anchor and there in pages and anchor not in known):
                wrong.append(f"{path.relative_to(root)}: {target}")
    return wrong


def _check(app, exception):
    from sphinx.util import logging  # here, so that the rest can be tested without Sphinx

    logger = logging.getLogger(__name__)
    if exception is None and app.builder.format == "html":
        for one in broken(app.outdir):
            logger.warning("link leads nowhere: %s", one)


def setup(app):
    """Register the check."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
