"""Links that read well in the sources, too.

A name such as `flgpr.scoring.roc` in running text links to its description, and a link to an example's program leads to
the page that was made of it.
"""

import re

from docutils import nodes
from sphinx import addnodes

NAME = re.compile(r"flgpr(\.\w+)+")
EXAMPLE = re.compile(r"\]\(((?:\.\./)*)gallery/(plot_\w+)\.py\)")


def _link(app, doctree):
    for literal in list(doctree.findall(nodes.literal)):
        found = NAME.match(literal.astext())
        if not found or isinstance(literal.parent, nodes.reference | addnodes.pending_xref):
            continue
        target = addnodes.pending_xref(
            "",
            literal.deepcopy(),
            refdomain="py",
            reftype="obj",
            reftarget=found.group(),
            refdoc=app.env.docname,
            refwarn=False,
            refexplicit=True,
        )
        literal.replace_self(target)


def _to_pages(app, docname, source):
    source[0] = EXAMPLE.sub(r"](\1examples/\2.rst)", source[0])


def setup(app):
    """Register both."""
    app.connect("doctree-read", _link)
    app.connect("source-read", _to_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
