from flgpr.viewer.server import Viewer as Viewer
from flgpr.viewer.server import serve as serve
