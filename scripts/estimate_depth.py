#!/usr/bin/env python3
"""Runs dgsfm.estimate_depth of the source tree, where the package is not
installed."""

import pathlib
import runpy

if __name__ == "__main__":
    package = pathlib.Path(__file__).resolve().parents[1] / "python" / "dgsfm"
    runpy.run_path(str(package / "estimate_depth.py"), run_name="__main__")
