"""Parts of Markdown files that are generated from stored runs:

    <!-- results:NAME -->
    generated
    <!-- /results -->
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from .errors import BenchmarkError

_OPENING = r"<!-- results:([\w-]+) -->\n"
_CLOSING = "<!-- /results -->"
_BLOCK = re.compile(f"{_OPENING}(.*?){re.escape(_CLOSING)}", re.DOTALL)


def block(name: str, lines: list[str]) -> list[str]:
    """Lines with the marks around them."""
    return [f"<!-- results:{name} -->", *lines, _CLOSING]


def read_blocks(text: str) -> dict[str, str]:
    """Contents of the blocks of a file; raises BenchmarkError if one is not
    closed or a name occurs twice."""
    found = _BLOCK.findall(text)
    names = [name for name, _ in found]
    num_openings = len(re.findall(_OPENING, text))
    if num_openings != len(found) or text.count(_CLOSING) != len(found):
        raise BenchmarkError("a block of results is not closed")
    if len(set(names)) != len(names):
        raise BenchmarkError("two blocks of results have one name")
    return dict(found)


def update_blocks(text: str, contents: Mapping[str, list[str]]) -> str:
    """The file with new contents; raises BenchmarkError for a block that
    nothing generates."""
    unknown = set(read_blocks(text)) - set(contents)
    if unknown:
        raise BenchmarkError(f"nothing generates the block '{min(unknown)}'")
    return _BLOCK.sub(
        lambda match: "\n".join(block(match[1], contents[match[1]])), text
    )
