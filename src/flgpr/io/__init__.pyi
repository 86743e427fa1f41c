from flgpr.formats import *  # noqa: F403
from flgpr.geo import *  # noqa: F403
from flgpr.store import *  # noqa: F403
