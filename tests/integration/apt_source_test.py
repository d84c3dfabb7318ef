"""Tests scripts/apt_source.sh on a small package archive of its own."""

import hashlib
import os
import pathlib
import subprocess
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
SOURCE = "sample_1.0.orig.tar.gz"


class AptSourceTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.write_archive(self.folder / "archive")
        (self.folder / "etc/sources.list.d").mkdir(parents=True)
        (self.folder / "apt.conf").write_text(
            f'Dir::Etc "{self.folder}/etc";\n'
            f'APT::Update::Post-Invoke {{"touch {self.folder}/hook";}};\n')

    def write_archive(self, archive):
        archive.mkdir()
        files = {SOURCE: b"source", "sample_1.0-1.dsc": b"description"}
        for name, content in files.items():
            (archive / name).write_bytes(content)
        sums = "".join(
            f"\n {hashlib.sha256(content).hexdigest()} {len(content)} {name}"
            for name, content in files.items())
        (archive / "Sources").write_text(
            "Package: sample\nBinary: sample\nVersion: 1.0-1\n"
            f"Format: 3.0 (quilt)\nDirectory: .\nChecksums-Sha256:{sums}\n")

    def download(self, package="sample=1.0-1"):
        return subprocess.run(
            [ROOT / "scripts/apt_source.sh", package, self.folder / "out"],
            env={**os.environ, "APT_CONFIG": str(self.folder / "apt.conf")},
            capture_output=True, text=True, check=False)

    def check_download(self):
        run = self.download()
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertEqual((self.folder / "out" / SOURCE).read_bytes(),
                         b"source")
        self.assertFalse((self.folder / "hook").exists())

    def test_reads_one_line_sources(self):
        (self.folder / "etc/sources.list").write_text(
            "# deb file:/nowhere ./\n"
            f"deb [trusted=yes] file:{self.folder}/archive ./\n")
        self.check_download()

    def test_reads_one_line_sources_of_the_folder(self):
        (self.folder / "etc/sources.list.d/a.list").write_text(
            f"deb-src [trusted=yes] file:{self.folder}/archive ./\n"
            f"deb [trusted=yes] file:{self.folder}/archive ./\n")
        self.check_download()

    def test_reads_deb822_sources(self):
        (self.folder / "etc/sources.list.d/a.sources").write_text(
            f"Types: deb\nURIs: file:{self.folder}/archive\nSuites: ./\n"
            "Trusted: yes\n\n"
            "Types: deb\nURIs: file:/nowhere\nSuites: ./\nEnabled: no\n")
        self.check_download()

    def test_names_a_package_that_is_not_there(self):
        (self.folder / "etc/sources.list").write_text(
            f"deb [trusted=yes] file:{self.folder}/archive ./\n")
        run = self.download("sample=2.0-1")
        self.assertEqual(run.returncode, 1)
        self.assertIn("sample=2.0-1 is not available", run.stderr)


if __name__ == "__main__":
    unittest.main()
