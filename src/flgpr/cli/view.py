"""The command ``flgpr view``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from flgpr import viewer


def view(
    paths: Annotated[
        list[Path] | None, Argument(help="Result folder or run; two results can be compared; none with --live.")
    ] = None,
    port: Annotated[int, Option(help="Port; 0 takes a free one.", min=0, max=65535)] = 0,
    host: Annotated[str, Option(help="Address to listen on.")] = "127.0.0.1",
    allow_remote: Annotated[bool, Option("--allow-remote", help="Let other machines see it.")] = False,
    no_browser: Annotated[bool, Option("--no-browser", help="Print the address only.")] = False,
    live: Annotated[Path | None, Option(help="JSON lines of a live detection to follow.")] = None,
    anchor: Annotated[Path | None, Option(help="TOML that ties the lane to the Earth.")] = None,
) -> None:
    """Show results in the browser, read-only and on this machine."""
    try:
        viewer.serve(paths or [], host, port, not no_browser, allow_remote, live, anchor=anchor, announce=typer.echo)
    except (ValueError, OSError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(2) from None
