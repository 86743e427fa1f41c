"""Forward-looking ground-penetrating radar: raw multistatic data to images, alarms and scores."""

from importlib.metadata import version

__version__ = version("flgpr")
