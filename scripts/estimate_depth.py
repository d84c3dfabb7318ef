#!/usr/bin/env python3
"""Runs dgsfm.estimate_depth of the source tree; see there."""

import pathlib
import runpy

PACKAGE = pathlib.Path(__file__).resolve().parents[1] / "python" / "dgsfm"

runpy.run_path(str(PACKAGE / "estimate_depth.py"), run_name="__main__")
