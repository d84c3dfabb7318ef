"""Man pages, completions and lists of options are those of --help.

Usage: command_documents_test.py COLMAP

Man pages are checked by groff and completions by zsh where these are installed.
"""

import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile


def run(*arguments, **options):
    return subprocess.run(
        list(map(str, arguments)),
        capture_output=True, text=True, check=True, **options,
    ).stdout  # fmt: skip


def options_of_help(colmap, command):
    text = run(colmap, command, "--help")
    # Up to the options that all commands have.
    return set(re.findall(r"^  --([A-Za-z0-9_.]+)", text.split("General options")[0], re.M))


def complete(script, colmap, *words):
    """What bash offers for the last of the words."""
    line = """
        source "$1"; shift
        COMP_WORDS=("$@"); COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
        _dgsfm "$1"; printf '%s\\n' "${COMPREPLY[@]}"
    """
    return run("bash", "-c", line, "bash", script, colmap, *words).split()


def check_man_pages(folder, program, commands):
    for command, entry in commands.items():
        page = folder / "man1" / f"{program}-{command}.1"
        text = page.read_text().replace("\\-", "-")
        for option in entry["options"]:
            assert f".BI --{option} " in text, (command, option)
    program_page = (folder / "man1" / f"{program}.1").read_text()
    assert all(command in program_page for command in commands)
    if shutil.which("groff"):
        for page in sorted((folder / "man1").iterdir()):
            result = subprocess.run(
                ["groff", "-man", "-Tutf8", "-ww", "-z", page],
                capture_output=True, text=True, check=True,
            )  # fmt: skip
            assert result.stderr == "", f"{page}: {result.stderr}"


def check_bash(script, colmap, commands):
    offered = complete(script, colmap, "")
    assert set(commands) <= set(offered), offered
    assert complete(script, colmap, "depth_imp") == ["depth_importer"]
    for command, entry in commands.items():
        offered = complete(script, colmap, command, "--")
        assert set(offered) >= {f"--{option}" for option in entry["options"]}, command
    assert complete(script, colmap, "depth_importer", "--over") == ["--overwrite"]
    assert complete(script, colmap, "depth_importer", "--overwrite", "") == ["0", "1"]
    # The shell offers files.
    assert complete(script, colmap, "depth_importer", "--depth_path", "") == []
    assert complete(script, colmap, "feature_extractor", "--") == []


def check_zsh(script, commands):
    if not shutil.which("zsh"):
        print("no zsh: its completion is not checked")
        return
    # The shell's own functions are replaced by ones that print their arguments.
    harness = """
        _arguments() { print -rl -- "$@" }
        _describe() { print -rl -- "${(P@)2}" }
        _files() { print files }
        script=$1; shift
        words=("$@"); CURRENT=$#
        source $script
    """

    def offered(*words):
        return run("zsh", "-f", "-c", harness, "zsh", script, "colmap", *words)

    described = offered("").splitlines()
    assert {line.split(":")[0] for line in described} >= set(commands), described
    for command, entry in commands.items():
        text = offered(command, "")
        for option in entry["options"]:
            assert f"--{option}[" in text, (command, option)
    assert offered("feature_extractor", "").strip() == "files"


def main():
    colmap = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for program in ("colmap", "dgsfm"):
            run(colmap, "command_documents", "--output_path", folder / program,
                "--program", program)  # fmt: skip
            documents = folder / program
            commands = json.loads((documents / "commands.json").read_text())
            for command, entry in commands.items():
                assert set(entry["options"]) == options_of_help(colmap, command), command
                assert all(option["help"] for option in entry["options"].values())
            page = (documents / "commands.md").read_text()
            for command, entry in commands.items():
                section = page.split(f"\n## {command}\n")[1].split("\n## ")[0]
                assert all(f"`--{option}`" in section for option in entry["options"])
            check_man_pages(documents, program, commands)
            check_bash(documents / f"{program}.bash", colmap, commands)
            check_zsh(documents / f"_{program}", commands)
        help_text = run(colmap, "help")
        assert "command_documents" not in help_text
        position = help_text.index("Commands of DGSFM")
        for command, entry in commands.items():
            line = re.search(rf"^  {command} +(.+)$", help_text, re.M)
            assert line and line.group(1) == entry["headline"], command
            assert line.start() > position
        if "Available commands of COLMAP" in help_text:
            assert help_text.index("Available commands of COLMAP") > line.end()
    print(f"{len(commands)} commands are documented")
    return 0


if __name__ == "__main__":
    sys.exit(main())
