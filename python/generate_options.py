"""Writes dgsfm/options.py from the options of the commands.

usage: generate_options.py FOLDER_OF_CORE OUTPUT
"""

import pathlib
import re
import sys
import textwrap

COMMANDS = [
    "depth_importer",
    "dense_match_importer",
    "depth_geometric_verifier",
    "depth_global_mapper",
    "depth_exporter",
]
# Arguments of functions.
NOT_OPTIONS = {"image_path"}

HEAD = '''"""Options of the commands, with their defaults.

Generated from the options of the command line: the option Group.field of a
command is the field group.field of its class here, and without the group where
that has the command's own name.
"""

from __future__ import annotations

import dataclasses

# Literal types are for readers of the source and type checkers.
from typing import Literal  # noqa: F401

from ._option_group import OptionGroup
'''


def snake_case(name):
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def camel_case(name):
    return "".join(word.capitalize() for word in name.split("_"))


def type_name(value, choices):
    if choices:
        return f"Literal[{', '.join(map(repr, choices))}]"
    return type(value).__name__


def docstring(text, indent):
    lines = textwrap.wrap(text.replace("\\", "\\\\"), 79 - len(indent) - 6)
    if len(lines) == 1:
        return f'{indent}"""{lines[0]}"""\n'
    return f'{indent}"""' + f"\n{indent}".join(lines) + '"""\n'


def class_text(name, summary, fields, groups):
    text = f"\n\n@dataclasses.dataclass\nclass {name}(OptionGroup):\n"
    text += docstring(summary, "    ")
    for field, value, help_text, choices in fields:
        text += f"\n    {field}: {type_name(value, choices)} = {value!r}\n"
        text += docstring(help_text[0].upper() + help_text[1:], "    ")
    for group in groups:
        text += (
            f"\n    {snake_case(group)}: {group}Options = dataclasses.field(\n"
            f"        default_factory=lambda: {group}Options()\n    )\n"
        )
        text += docstring(f"Options {group}.* of the command.", "    ")
    return text


def module_text(describe):
    text = HEAD
    written = {}
    for command in COMMANDS:
        groups = {"": []}
        for name, value, help_text, choices in describe(command):
            group, _, field = name.rpartition(".")
            if name not in NOT_OPTIONS:
                groups.setdefault(group, []).append((field, value, help_text, choices))
        fields = groups.pop("")
        own_group = camel_case(command)
        own_fields = groups.pop(own_group, [])
        names = [field[0] for field in fields + own_fields]
        if len(set(names)) < len(names):
            raise ValueError(f"two options of {command} have one name")
        for group, group_fields in groups.items():
            if written.setdefault(group, group_fields) != group_fields:
                raise ValueError(f"two commands differ in their options {group}.*")
            if written[group] is group_fields:
                text += class_text(
                    f"{group}Options",
                    f"Options {group}.* of {command} and others.",
                    group_fields,
                    [],
                )
        text += class_text(
            f"{camel_case(command)}Options",
            f"Options of the command {command}.",
            fields + own_fields,
            groups,
        )
        if groups:
            text += f"\n    _GROUPS = {({snake_case(g): g for g in groups})!r}\n"
        if own_fields:
            text += f"\n    _OWN_GROUP = {own_group!r}\n"
            text += "    _OWN_FIELDS = {\n"
            text += "".join(f"        {field[0]!r},\n" for field in own_fields)
            text += "    }\n"
    return text


def main():
    folder, output = sys.argv[1:]
    sys.path.insert(0, folder)
    import _core

    pathlib.Path(output).write_text(
        module_text(_core.describe_options), encoding="utf-8"
    )


if __name__ == "__main__":
    main()
