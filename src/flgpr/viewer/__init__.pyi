from flgpr.viewer.server import Viewer, serve

__all__ = ["Viewer", "serve"]
