"""Turn a name such as `flgpr.scoring.roc` in running text into a link to its description."""

import re

from docutils import nodes
from sphinx import addnodes

NAME = re.compile(r"flgpr(\.\w+)+")


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


def setup(app):
    """Register the transform."""
    app.connect("doctree-read", _link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
