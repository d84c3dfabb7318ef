"""Every command in the documents runs, or is marked as one that cannot.

Usage: docs_commands_test.py COLMAP [PAGE...]

A block of commands has a comment before it, which readers do not see:

    <!-- commands: run -->            is run here, page by page
    <!-- commands: need ... -->       needs what a test has not
    <!-- commands: by hand, ... -->   installs, builds or measures

The options in all of them exist, and so do all others that the documents name.
Commands of COLMAP itself, and the blocks that need them, are left out where no
COLMAP is installed. Exit code 77 without a synthetic scene's images to run on.
"""

import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "benchmark/README.md",
    ROOT / "patches/README.md",
    *sorted((ROOT / "docs").glob("*.md")),
]
FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.M | re.S)
MARKER = re.compile(r"<!-- commands: (run|need [^>]+|by hand, [^>]+) -->\n\s*$")
# Options of programs that are not here.
OTHERS = {
    "depths",  # of 3D Gaussian splatting's trainer
    "nthreads",  # of Dask's workers
    "rm", "tag", "volume",  # of docker
    "build", "install", "prefix", "preset",  # of CMake
}  # fmt: skip
GROUPS = (
    "DepthGlobalMapper|TwoViewDepth|PairVerification|DepthConsistency"
    "|DepthAlignment|DepthSampling|MultiViewDepth|PartJoining"
)


def blocks(page):
    """Kind and text of each block of commands of a page."""
    text = page.read_text()
    for match in FENCE.finditer(text):
        if match[2] not in ("sh", "bash", "console", "shell"):
            continue
        marker = MARKER.search(text[: match.start()])
        line = text[: match.start()].count("\n") + 1
        assert marker, f"{page}:{line}: no comment <!-- commands: ... --> before it"
        yield marker[1], match[3]


def command_lines(text):
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words:
            yield words


class Options:
    """Which options there are."""

    def __init__(self, colmap):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run(
                [colmap, "command_documents", "--output_path", folder], check=True
            )
            commands = json.loads(pathlib.Path(folder, "commands.json").read_text())
        general = {"project_path", "log_level", "help"}
        self.ours = {name: {*entry["options"], *general}
                     for name, entry in commands.items()}  # fmt: skip
        self.help_text = subprocess.run(
            [colmap, "help"], capture_output=True, text=True, check=True
        ).stdout
        self.has_colmap = "Available commands of COLMAP" in self.help_text
        self.colmap = colmap
        self.theirs = {}
        # Options of scripts, and of programs that scripts call.
        self.scripts = "".join(
            file.read_text(errors="ignore")
            for folder in ("scripts", "benchmark", "tests", "python", ".ci")
            for file in (ROOT / folder).rglob("*")
            if file.suffix in (".py", ".sh", ".txt", ".cmake") and file != pathlib.Path(__file__)
        )

    def of_colmap(self, command):
        if command not in self.theirs:
            result = subprocess.run(
                [self.colmap, command, "--help"],
                capture_output=True, text=True, check=False,
                env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
            )  # fmt: skip
            names = re.findall(r"--([A-Za-z0-9_.]+)", result.stdout + result.stderr)
            assert names, f"colmap {command} is no command"
            self.theirs[command] = set(names)
        return self.theirs[command]

    def check_command(self, page, words):
        if words[0] not in ("colmap", "dgsfm") or len(words) < 2:
            script = words[0]
            if script.startswith(("scripts/", "build/", ".ci/", "tests/")):
                assert script.startswith("build/") or (ROOT / script).exists(), (
                    f"{page}: {script} does not exist"
                )
            return
        command = words[1]
        if command in self.ours:
            known = self.ours[command]
        elif command in ("help", "gui", "COMMAND") or not self.has_colmap:
            return
        else:
            known = self.of_colmap(command)
        for word in words[2:]:
            if word.startswith("--"):
                name = word[2:].split("=")[0]
                assert name in known, f"{page}: colmap {command} has no {word}"

    def check_names(self, page):
        """Options that the text names, of any command."""
        text = page.read_text()
        ours = set().union(*self.ours.values())
        for name in set(re.findall(r"(?<![\w-])--([A-Za-z][A-Za-z0-9_.]*\w)(?!\w*[-*])", text)):
            if name in ours | OTHERS or f"--{name}" in self.scripts:
                continue
            if name.endswith("_") and any(option.startswith(name) for option in ours):
                continue  # the beginning of several
            if not self.has_colmap:
                continue
            commands = ("feature_extractor", "model_aligner", "image_undistorter",
                        "exhaustive_matcher", "stereo_fusion", "poisson_mesher")  # fmt: skip
            assert any(name in self.of_colmap(command) for command in commands), (
                f"{page}: no command has --{name}"
            )
        for name in set(re.findall(rf"\b((?:{GROUPS})\.[a-z]\w*)", text)):
            if name.endswith("_"):  # the beginning of several
                assert any(option.startswith(name) for option in ours), f"{page}: {name}"
            else:
                assert name in ours, f"{page}: no command has {name}"


def prepare(colmap, folder):
    """A COLMAP without graphics, and the user's data: photos, depth, a model."""
    tools = folder / "tools"
    tools.mkdir()
    shim = tools / "colmap"
    # Tests have neither display, graphics card nor much time.
    shim.write_text(
        f"""#!/bin/bash
add() {{ [[ " ${{arguments[*]}} " == *" $1 "* ]] || arguments+=("$1" "$2"); }}
arguments=("$@")
case $1 in
  feature_extractor)
    add --SiftExtraction.use_gpu 0
    add --SiftExtraction.max_num_features 800 ;;
  *_matcher) add --SiftMatching.use_gpu 0 ;;
esac
exec {shlex.quote(str(colmap))} "${{arguments[@]}}"
"""
    )
    shim.chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{tools}:{os.environ['PATH']}",
        "QT_QPA_PLATFORM": "offscreen",
    }
    data = folder / "data"
    script = """
        set -e
        colmap depth_scene_synthesizer --output_path scene --num_images 10 \\
          --width 400 --height 300 --focal_length 350
        mv scene/images photos; mv scene/depth depth; mv scene/gt truth
        colmap feature_extractor --database_path my.db --image_path photos \\
          --ImageReader.single_camera 1
        colmap exhaustive_matcher --database_path my.db
        colmap depth_importer --database_path my.db --depth_path depth
        colmap depth_global_mapper --database_path my.db --image_path photos --output_path model
    """
    data.mkdir()
    result = subprocess.run(
        ["bash", "-c", script], cwd=data, env=environment,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    return data, environment


def main():
    colmap = pathlib.Path(sys.argv[1]).resolve()
    pages = [pathlib.Path(page).resolve() for page in sys.argv[2:]] or PAGES
    options = Options(colmap)
    num_run = num_marked = 0
    to_run = {}
    for page in pages:
        name = page.relative_to(ROOT)
        options.check_names(page)
        for kind, text in blocks(page):
            for words in command_lines(text):
                options.check_command(name, words)
            if kind == "run":
                to_run.setdefault(page, []).append(text)
            else:
                num_marked += 1
    if not options.has_colmap:
        print("skipped: no COLMAP extracts features")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        data, environment = prepare(colmap, pathlib.Path(folder))
        for page, texts in to_run.items():
            work = pathlib.Path(folder) / page.stem
            shutil.copytree(data, work)
            if page.stem == "getting_started":  # begins with nothing
                shutil.rmtree(work)
                work.mkdir()
            for text in texts:
                result = subprocess.run(
                    ["bash", "-e", "-c", text], cwd=work, env=environment,
                    capture_output=True, text=True, check=False,
                )  # fmt: skip
                assert result.returncode == 0, (
                    f"{page}:\n{text}\n{result.stdout}{result.stderr}"
                )
                num_run += 1
    print(f"{num_run} blocks of commands run, {num_marked} are marked")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except AssertionError as error:
        print(error)
        sys.exit(1)
