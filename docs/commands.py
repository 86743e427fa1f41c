"""A directive that lists every command of the command line with its arguments and options."""

import typer
from docutils import nodes
from docutils.parsers.rst import Directive

from flgpr.commands.app import app


def _walk(command, words):
    inner = getattr(command, "commands", None)
    if inner is None:
        yield words, command
        return
    for name in sorted(inner):
        yield from _walk(inner[name], [*words, name])


def _usage(words, command):
    parts = [" ".join(words)]
    for one in command.params:
        if one.param_type_name == "argument":
            name = one.name.upper() + ("..." if one.nargs == -1 else "")
            parts.append(name if one.required else f"[{name}]")
    return " ".join([*parts, "[OPTIONS]"])


class Commands(Directive):
    """Every command as a section with a table of what it takes."""

    def run(self):
        """Make the sections."""
        made = []
        for words, command in _walk(typer.main.get_command(app), ["flgpr"]):
            title = " ".join(words)
            section = nodes.section(ids=[nodes.make_id(title)], names=[title.lower()])
            section += nodes.title(title, title)
            usage = _usage(words, command)
            section += nodes.paragraph("", (command.help or "").strip())
            section += nodes.literal_block(usage, usage, language="none")
            rows = nodes.definition_list()
            for one in command.params:
                if not one.help:
                    continue
                term = nodes.term("", "")
                names = (
                    [one.name.upper()]
                    if one.param_type_name == "argument"
                    else [*one.opts, *one.secondary_opts]
                )
                for number, name in enumerate(names):
                    term += [nodes.Text(", ")] * bool(number) + [nodes.literal(name, name)]
                default = (
                    ""
                    if one.default in (None, False, ()) or callable(one.default)
                    else f" [{one.default}]"
                )
                rows += nodes.definition_list_item(
                    "", term, nodes.definition("", nodes.paragraph("", one.help + default))
                )
            section += rows
            made.append(section)
        return made


def setup(app):
    """Register the directive."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
