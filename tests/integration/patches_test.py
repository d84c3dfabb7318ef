"""Tests that the patches apply to COLMAP's unpatched source, one after the
other, and say what they are."""

import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDER = ROOT / "patches/colmap-3.8"
FIELDS = ["Description", "Origin", "Forwarded", "Last-Update"]
# Exit code of build_colmap.sh without source, and CTest's of a skipped test.
NO_SOURCE = 3
SKIPPED = 77


def check_header(name, text):
    header = text.split("\n---\n")[0].splitlines()
    for field in FIELDS:
        if not any(line.startswith(field + ": ") for line in header):
            sys.exit(f"{name}: no DEP-3 field {field}")


def main():
    series = (FOLDER / "series").read_text().split()
    if sorted(series) != sorted(path.name for path in FOLDER.glob("*.patch")):
        sys.exit("series does not list the patches of the folder")
    with tempfile.TemporaryDirectory() as source:
        build = subprocess.run(
            [ROOT / "scripts/build_colmap.sh", "--source", source],
            check=False)
        if build.returncode == NO_SOURCE:
            print("skipped: the source of COLMAP cannot be obtained")
            sys.exit(SKIPPED)
        build.check_returncode()
        for name in series:
            patch = FOLDER / name
            check_header(name, patch.read_text())
            run = subprocess.run(
                ["patch", "--directory", source, "--strip", "1", "--batch",
                 "--fuzz", "0", "--input", patch],
                check=True, capture_output=True, text=True)
            if "offset" in run.stdout:
                sys.exit(f"{name}: does not fit exactly\n{run.stdout}")
            print(f"{name}: applies")


if __name__ == "__main__":
    main()
