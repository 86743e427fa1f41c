"""Forward-looking ground-penetrating radar: raw multistatic data to images, alarms and scores."""

import sys
from importlib import import_module
from typing import Any

from flgpr.lazy import Verbs, face

_load, __dir__, __all__ = face(__name__, __file__)
# These two names are packages as well; called they do what they are named for.
__verbs__ = {
    "detect": ("flgpr.commands.detect", "detect"),
    "simulate": ("flgpr.simulate", "simulate"),
}
sys.modules[__name__].__class__ = Verbs
if "xarray" in sys.modules:  # otherwise it is done when flgpr opens or makes the first run
    import_module("flgpr.model.run")  # gives every dataset `run.flgpr`


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version("flgpr")
    if name in __verbs__:
        package = import_module(f"flgpr.{name}")
        return vars(sys.modules[__name__]).get(name, package)  # there is no verb until it is loaded
    return _load(name)
