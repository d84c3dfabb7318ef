"""The log of depth_global_mapper is a story of about ten lines.

Usage: mapper_story_test.py COLMAP

Log and closing words of a run are those of mapper_story.txt beside this file,
numbers and times aside; --log_level 1 adds the figures of stages.
"""

import pathlib
import re
import subprocess
import sys
import tempfile

GOLDEN = pathlib.Path(__file__).with_name("mapper_story.txt")


def masked(text):
    text = re.sub(r" \((\d+ min )?[\d.]+ s\)", "", text)
    text = re.sub(r"\((\d+ min )?[\d.]+ s, \d+ MB\)", "(TIME, N MB)", text)
    # What counts are images in models, all else may differ a little.
    return "\n".join(
        line if line.startswith("registered") else re.sub(r"\d[\d.,]*\d|\d", "N", line)
        for line in text.splitlines()
    )


def main():
    colmap = str(pathlib.Path(sys.argv[1]).resolve())
    with tempfile.TemporaryDirectory() as folder:

        def run(*arguments):
            return subprocess.run(
                [colmap, *arguments],
                cwd=folder, capture_output=True, text=True, check=True,
            )  # fmt: skip

        run(
            "depth_scene_synthesizer", "--output_path", "scene",
            "--database_only", "1", "--num_images", "12",
            "--num_points_per_image", "120", "--num_false_pairs", "2",
        )  # fmt: skip
        command = (
            "depth_global_mapper", "--database_path", "scene/database.db",
            "--output_path", "models",
        )  # fmt: skip
        told = run(*command)
        found = masked(told.stderr) + "\n--\n" + masked(told.stdout) + "\n"
        if found != GOLDEN.read_text():
            print(f"The story differs from {GOLDEN.name}:\n{found}")
            return 1
        detailed = run(*command, "-v", "1")
        for text in ("load_scene: ", "rotation_averaging: ", "Rotations: "):
            assert text in detailed.stderr, detailed.stderr
        assert "ERROR" not in detailed.stderr and "WARNING" not in detailed.stderr
        failed = subprocess.run(
            [colmap, "depth_global_mapper", "--database_path", "scene/database.db",
             "--output_path", "models", "--log_level", "much"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert failed.returncode == 2 and "log_level" in failed.stderr, failed.stderr
    print("the story is as it should be")
    return 0


if __name__ == "__main__":
    sys.exit(main())
