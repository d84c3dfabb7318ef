#!/usr/bin/env python3
"""Checks what the sources include.

Layers depend in one direction, estimation touches no files and no database,
and no header of ours has the path of a header of COLMAP, whose own headers
would then include ours.

usage: check_layers.py [--colmap-include FOLDER] [ROOT]

FOLDER is the one with "base", "sfm" and so on of an installed COLMAP; without
it the paths are not compared. Prints one line per violation; exit code 1 if
there is any.
"""

import argparse
import pathlib
import re
import sys

# A layer includes itself and those before it.
LAYERS = ["colmap_ext", "estimators", "sfm", "controllers", "python"]

SCENE = r"<colmap/base/(camera|camera_rig|correspondence_graph|image|point2d" \
        r"|point3d|reconstruction|reconstruction_manager|track)\.h>"
FILES_AND_DATABASES = r"<(fstream|filesystem|iostream|sqlite3\.h)>" \
                      r"|.*(database|sqlite)\w*\.h[\">]"

# What a layer must not include, as regular expressions, with the reason.
FORBIDDEN = {
    "colmap_ext": [],
    "estimators": [
        (FILES_AND_DATABASES, "estimators take and return values only"),
        (SCENE, "estimators know no scene objects"),
    ],
    "sfm": [(FILES_AND_DATABASES, "only controllers open files")],
    "controllers": [],
    "python": [],
}

INCLUDE = re.compile(r'^\s*#\s*include\s*([<"][^>"]+[>"])')


def check_include(layer, include):
    """Returns what is wrong with an include of a file of a layer, or None."""
    if include.startswith('"'):
        folder = include[1:].split("/")[0]
        if folder not in LAYERS:
            return "quotes are for headers of a layer, from the root on"
        if LAYERS.index(folder) > LAYERS.index(layer):
            return f"{layer} is below {folder}"
    for pattern, reason in FORBIDDEN[layer]:
        if re.match(pattern, include):
            return reason
    return None


def check_tree(root, colmap_include=None):
    """Returns the violations in the layers under a root, as lines of text."""
    violations = []
    for layer in LAYERS:
        for path in sorted((root / layer).rglob("*")):
            if path.suffix not in (".h", ".cc"):
                continue
            name = path.relative_to(root)
            if path.suffix == ".h" and colmap_include:
                if (colmap_include / name).exists():
                    violations.append(f"{name}: COLMAP has a header {name}")
            lines = path.read_text(encoding="utf-8").splitlines()
            for number, line in enumerate(lines, 1):
                match = INCLUDE.match(line)
                problem = match and check_include(layer, match[1])
                if problem:
                    violations.append(
                        f"{name}:{number}: includes {match[1]}: {problem}")
    return violations


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--colmap-include", type=pathlib.Path)
    parser.add_argument("root", nargs="?", type=pathlib.Path,
                        default=pathlib.Path(__file__).resolve().parents[1])
    args = parser.parse_args()
    if args.colmap_include and not (args.colmap_include / "base").is_dir():
        parser.error(f"{args.colmap_include} holds no headers of COLMAP")
    violations = check_tree(args.root, args.colmap_include)
    print("\n".join(violations + [f"{len(violations)} violation(s)"]))
    return 1 if violations else 0


if __name__ == "__main__":
    sys.exit(main())
