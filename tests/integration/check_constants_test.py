"""Tests scripts/check_constants.py on trees with one fault each."""

import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "scripts"))
from check_constants import check_tree  # noqa: E402

SOURCE = """
constexpr double kA = 0.5;  // constexpr double kB = 1;
constexpr int kC[] = {1,
                      2};
struct XOptions {
  // Of something.
  int count = 3;
};
double Twice(double x) { return  2 * x; }
"""
COUNTS = "4 numbers, 0 switches, 1 of the numbers are fitted"
ROWS = ["| `kA` | sfm/a.h | `0.5` [px] | bound | fitted on a set |",
        "| `kC` | sfm/a.h | `{1, 2}` | indices | definition |",
        "| `XOptions::count` | sfm/a.h | `3` | | paper |",
        "| `return 2 * x` | sfm/a.h | `2` | twice | definition |"]


class CheckConstantsTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        (self.root / "docs").mkdir()
        (self.root / "sfm").mkdir()

    def check(self, source, rows, counts=COUNTS):
        (self.root / "sfm/a.h").write_text(source)
        (self.root / "docs/constants.md").write_text(
            "\n".join([counts, *rows]))
        return check_tree(self.root)

    def test_accepts_complete_list(self):
        self.assertEqual(self.check(SOURCE, ROWS), [])

    def test_finds_missing_rows(self):
        for row in ROWS[:3]:
            with self.subTest(row=row):
                rows = [other for other in ROWS if other != row]
                faults = self.check(SOURCE, rows)
                self.assertTrue(any("has no row" in fault for fault in faults))

    def test_defaults_that_are_off_need_no_row(self):
        field = "  // Bound, 0 = off.\n  double bound = 0;\n};\ndouble Twice"
        source = SOURCE.replace("};\ndouble Twice", field)
        self.assertEqual(self.check(source, ROWS), [])
        on = source.replace("bound = 0", "bound = 5")
        self.assertEqual(len(self.check(on, ROWS)), 1)

    def test_finds_rows_whose_constant_is_gone(self):
        for old, new in [("kA", "kB"), ("count", "size"), ("2 * x", "x + x")]:
            with self.subTest(old=old):
                faults = self.check(SOURCE.replace(old, new), ROWS)
                self.assertTrue(any(fault.startswith("docs/constants.md: sfm")
                                    for fault in faults))

    def test_finds_changed_values(self):
        for old, new in [("0.5", "0.6"), ("{1,", "{3,"), ("= 3", "= 4")]:
            with self.subTest(old=old):
                faults = self.check(SOURCE.replace(old, new), ROWS)
                self.assertEqual(len(faults), 2)

    def test_finds_wrong_counts(self):
        for old, new in [("4", "14"), ("0 s", "1 s"), ("1 of", "2 of")]:
            with self.subTest(old=old):
                faults = self.check(SOURCE, ROWS, COUNTS.replace(old, new))
                self.assertEqual(len(faults), 1)


if __name__ == "__main__":
    unittest.main()
