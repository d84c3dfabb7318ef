#!/usr/bin/env python3
"""Checks that docs/constants.md lists the constants of the sources.

Every constexpr number and every default of an option in estimators/ and sfm/
needs a row with its file and value, but for defaults that the comment calls
"0 = off", and what a row names must still be there.
The name of a row is `kName`, `Options::name`, or, for numbers without a name,
the piece of source that has the number. Rows on other folders need not be
complete. The numbers of rows at the top of the list must hold.

usage: check_constants.py [ROOT]

Prints one line per fault; exit code 1 if there is any.
"""

import argparse
import collections
import pathlib
import re
import sys

LISTED_LAYERS = ["estimators", "sfm"]

CONSTANT = re.compile(r"\bconstexpr\s+[\w:<>, ]+?\s+(k[A-Z]\w*)"
                      r"(?:\[[^\]]*\])*\s*=\s*([^;]*);")
OPTIONS = re.compile(r"\bstruct\s+(\w*Options)\s*\{(.*?)\n\};", re.DOTALL)
DEFAULT = re.compile(r"^  (?:bool|int|double|float|size_t|uint\d+_t)"
                     r"\s+(\w+)\s*=\s*([^;]*);", re.MULTILINE)
ROW = re.compile(r"^\|\s*`([^`]+)`\s*\|\s*([\w/.]+)\s*\|\s*`([^`]+)`.*\|"
                 r"\s*([^|]+?)\s*\|$")
SWITCH = ("true", "false")


# A field whose comment, on the lines before it, has "0 = off".
OFF = re.compile(r"0 = off[^\n]*\n(?:\s*//[^\n]*\n)*\s*\w+\s+(\w+)\s*=\s*0;")


def squeeze(text):
    """Text whose white space is single spaces."""
    return " ".join(text.split())


def read_source(path):
    return re.sub(r"//.*", "", path.read_text(encoding="utf-8"))


def find_constants(text):
    """Returns the (name, value) of a source."""
    constants = CONSTANT.findall(text)
    for struct, body in OPTIONS.findall(text):
        constants += [(f"{struct}::{name}", value)
                      for name, value in DEFAULT.findall(body)]
    return [(name, squeeze(value)) for name, value in constants]


def check_counts(text, rows):
    """Returns what the text says of its (file, name, value, origin) wrongly."""
    numbers = [row for row in rows if row[2] not in SWITCH]
    num_fitted = sum(row[3].startswith("fitted") for row in numbers)
    counts = [f"{len(numbers)} numbers",
              f"{len(rows) - len(numbers)} switches",
              f"{num_fitted} of the numbers are fitted"]
    return [f"docs/constants.md does not say: {count}" for count in counts
            if not re.search(r"\b" + count + r"\b", squeeze(text))]


def check_tree(root):
    """Returns the faults of a tree, as lines of text."""
    text = (root / "docs/constants.md").read_text(encoding="utf-8")
    matches = [ROW.match(line) for line in text.splitlines()]
    listed = [(file, squeeze(name), squeeze(value), origin)
              for name, file, value, origin in
              (match.groups() for match in matches if match)]
    rows = collections.Counter(row[:3] for row in listed)
    paths = {root / file for file, _, _ in rows if (root / file).is_file()}
    for layer in LISTED_LAYERS:
        paths |= {path for path in (root / layer).rglob("*")
                  if path.suffix in (".h", ".cc")}

    texts, constants, off = {}, collections.Counter(), set()
    for path in sorted(paths):
        file = path.relative_to(root).as_posix()
        source = read_source(path)
        texts[file] = squeeze(source)
        off |= {(file, name) for name in
                OFF.findall(path.read_text(encoding="utf-8"))}
        constants.update((file, *constant)
                         for constant in find_constants(source))

    faults = check_counts(text, listed)
    for file, name, value in sorted((constants - rows).elements()):
        is_off = (file, name.split("::")[-1]) in off
        if file.split("/")[0] in LISTED_LAYERS and not is_off:
            faults.append(f"{file}: {name} = {value} has no row")
    for file, name, value in sorted((rows - constants).elements()):
        is_number_without_name = re.search(r"[^\w:]", name) and value in name
        if not (is_number_without_name and name in texts.get(file, "")):
            faults.append(f"docs/constants.md: {file} has no {name} = {value}")
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", nargs="?", type=pathlib.Path,
                        default=pathlib.Path(__file__).resolve().parents[1])
    faults = check_tree(parser.parse_args().root)
    print("\n".join(faults + [f"{len(faults)} fault(s)"]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
