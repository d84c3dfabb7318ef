"""The version, as pip has it."""

from importlib import metadata

try:
    __version__ = metadata.version("dgsfm")
except metadata.PackageNotFoundError:  # In the build folder.
    __version__ = "0"
