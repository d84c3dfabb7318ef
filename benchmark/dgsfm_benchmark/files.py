"""Files that appear whole, and their identities."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
from pathlib import Path


def file_digest(path: Path) -> str:
    """First 16 hexadecimal digits of the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


def value_digest(value: object) -> str:
    """Digest of a value that JSON can hold."""
    text = json.dumps(value, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def write_text(path: Path, text: str) -> None:
    """Writes a file whole or not at all."""
    temporary = path.with_name(path.name + ".new")
    temporary.write_text(text)
    os.replace(temporary, path)


def write_json(path: Path, value: object) -> None:
    """Writes a file whole or not at all."""
    write_text(path, json.dumps(value, indent=1, sort_keys=True) + "\n")


def rounded(value: float | None, decimals: int) -> float | int | None:
    """A number with so many decimals, or -decimals significant digits; None
    for none and for what is no number, which JSON does not know."""
    if value is None or not math.isfinite(value):
        return None
    if decimals < 0:
        value = float(f"{value:.{-decimals}g}")
    else:
        value = round(value, decimals)
    return int(value) if value == int(value) else value


def empty_folder(path: Path) -> Path:
    """Creates a folder, or empties it."""
    if path.exists():
        shutil.rmtree(path)
    path.mkdir(parents=True)
    return path


def slug(name: str) -> str:
    """A name as that of a folder."""
    kept = (c if c.isalnum() or c in "-_." else "_" for c in name)
    return "".join(kept)
