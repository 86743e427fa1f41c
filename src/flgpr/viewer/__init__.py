"""The viewer: a read-only page on this machine. It reads what detection wrote and never computes."""

from flgpr.viewer.server import Viewer, serve

__all__ = ["Viewer", "serve"]
