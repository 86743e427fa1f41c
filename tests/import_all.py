"""Imports every module of the package, and prints how many there are: ``python import_all.py``."""

import importlib
import pkgutil

import flgpr
import flgpr_ground
import flgpr_papers

if __name__ == "__main__":
    count = 0
    for package in (flgpr, flgpr_ground, flgpr_papers):
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            # The first runs commands; the second needs a library that only the extra cuda brings.
            if not module.name.endswith(("__main__", "kernels.gpu")):
                importlib.import_module(module.name)
                count += 1
    print(f"{count} modules of {flgpr.__file__}")
