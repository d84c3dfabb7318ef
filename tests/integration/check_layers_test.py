"""Tests scripts/check_layers.py on trees with one fault each."""

import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "scripts"))
from check_layers import LAYERS, check_tree  # noqa: E402


class CheckLayersTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)

    def check(self, path, text=""):
        """Violations of a tree that consists of one file."""
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return check_tree(self.root, self.root / "colmap")

    def test_accepts_includes_of_the_same_and_lower_layers(self):
        text = "".join(f'#include "{layer}/x.h"\n' for layer in LAYERS)
        self.assertEqual(self.check(f"{LAYERS[-1]}/a.cc", text), [])

    def test_finds_include_of_a_higher_layer(self):
        for index, layer in enumerate(LAYERS[:-1]):
            text = f'#include "{LAYERS[index + 1]}/x.h"\n'
            self.assertEqual(len(self.check(f"{layer}/a.h", text)), index + 1)

    def test_finds_include_outside_of_the_layers(self):
        self.assertTrue(self.check("sfm/a.h", ' # include "x.h"\n'))

    def test_finds_files_and_databases_below_controllers(self):
        for include in ["<fstream>", "<filesystem>", "<iostream>",
                        "<sqlite3.h>", "<colmap/base/database_cache.h>",
                        '"colmap_ext/database/scene_database.h"']:
            for layer in ["estimators", "sfm"]:
                with self.subTest(include=include, layer=layer):
                    violations = self.check(f"{layer}/a.cc",
                                            f"#include {include}\n")
                    self.assertEqual(len(violations), 1)
                    (self.root / layer / "a.cc").unlink()

    def test_finds_scene_objects_in_estimators_only(self):
        text = "#include <colmap/base/reconstruction.h>\n"
        self.assertEqual(self.check("sfm/a.cc", text), [])
        self.assertEqual(len(self.check("estimators/a.cc", text)), 1)

    def test_finds_header_with_the_path_of_one_of_colmap(self):
        (self.root / "colmap/sfm").mkdir(parents=True)
        (self.root / "colmap/sfm/a.h").touch()
        self.assertEqual(self.check("sfm/b.h"), [])
        self.assertEqual(len(self.check("sfm/a.h")), 1)


if __name__ == "__main__":
    unittest.main()
