"""Tests scripts/build_colmap.sh without a network, and without compiling.

Exit code 77 where the source of COLMAP is in no cache.
"""

import os
import pathlib
import stat
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
CACHE = pathlib.Path(os.environ.get("XDG_CACHE_HOME", pathlib.Path.home() / ".cache"))
ARCHIVE = CACHE / "dgsfm/colmap-3.8-1/colmap_3.8.orig.tar.gz"
# In place of the real ones: a build of 40 steps, which waits for WAIT in its midst.
CMAKE = """#!/bin/bash
case "$1 $*" in
  --build*) for i in {1..40}; do
      echo "[$i/40] Building CXX object $i"
      while [[ $i == 20 && -n $WAIT && -e $WAIT ]]; do sleep 0.1; done
    done
    [[ -z $FAIL ]] || { echo "error: no such thing"; exit 1; } ;;
  --install*) mkdir -p "${2%build}install/share/colmap" ;;
esac
"""
NO_APT = "#!/bin/sh\necho no network >&2\nexit 100\n"


class BuildColmapTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.tools = self.folder / "tools"
        self.tools.mkdir()
        self.tool("apt-get", NO_APT)

    def tool(self, name, text):
        path = self.tools / name
        path.write_text(text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)

    def run_script(self, *arguments, **variables):
        environment = {
            **os.environ,
            "PATH": f"{self.tools}:{os.environ['PATH']}",
            "XDG_CACHE_HOME": str(self.folder / "cache"),
            **{name: str(value) for name, value in variables.items()},
        }
        return subprocess.run(
            [ROOT / "scripts/build_colmap.sh", *arguments],
            env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip

    def test_takes_the_source_from_an_archive(self):
        source = self.folder / "source"
        run = self.run_script("--source", source, DGSFM_COLMAP_ARCHIVE=ARCHIVE)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertTrue((source / "src/base/camera.cc").exists())
        self.assertFalse((self.folder / "cache/dgsfm/colmap-3.8-1").exists())

    def test_refuses_another_archive(self):
        wrong = self.folder / "wrong.tar.gz"
        wrong.write_bytes(b"something else")
        for archive in (wrong, self.folder / "missing.tar.gz"):
            run = self.run_script("--source", self.folder / "source",
                                  DGSFM_COLMAP_ARCHIVE=archive)  # fmt: skip
            self.assertEqual(run.returncode, 3)
            self.assertIn(str(archive), run.stderr)

    def test_names_the_archive_where_apt_has_no_source(self):
        run = self.run_script("--source", self.folder / "source")
        self.assertEqual(run.returncode, 3)
        self.assertIn("DGSFM_COLMAP_ARCHIVE", run.stderr)

    def test_shows_progress_and_the_log(self):
        self.tool("cmake", CMAKE)
        run = self.run_script(DGSFM_COLMAP_ARCHIVE=ARCHIVE)
        self.assertEqual(run.returncode, 0, run.stderr)
        log = self.folder / "cache/dgsfm/build.log"
        self.assertIn(f"log: {log}", run.stderr)
        self.assertEqual(run.stderr.count(" % after "), 10, run.stderr)
        self.assertIn("[40/40]", log.read_text())
        # The second time there is nothing to do.
        prefix = run.stdout.strip()
        run = self.run_script(FAIL=1)
        self.assertEqual((run.returncode, run.stdout.strip()), (0, prefix), run.stderr)

    def test_shows_progress_while_it_builds(self):
        self.tool("cmake", CMAKE)
        wait = self.folder / "wait"
        wait.touch()
        environment = {
            **os.environ, "PATH": f"{self.tools}:{os.environ['PATH']}",
            "XDG_CACHE_HOME": str(self.folder / "cache"),
            "DGSFM_COLMAP_ARCHIVE": str(ARCHIVE), "WAIT": str(wait),
        }  # fmt: skip
        with subprocess.Popen(
            [ROOT / "scripts/build_colmap.sh"], env=environment, text=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        ) as process:  # fmt: skip
            for line in process.stderr:
                if " 50 % after " in line:
                    break
            else:
                self.fail("no line at half of the work")
            wait.unlink()
            process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0)

    def test_shows_the_end_of_the_log_of_a_failure(self):
        self.tool("cmake", CMAKE)
        run = self.run_script(DGSFM_COLMAP_ARCHIVE=ARCHIVE, FAIL=1)
        self.assertEqual(run.returncode, 1)
        self.assertIn("error: no such thing", run.stderr)
        self.assertEqual(run.stdout, "")


if __name__ == "__main__":
    if not ARCHIVE.exists():
        print(f"skipped: no {ARCHIVE}")
        sys.exit(77)
    unittest.main()
