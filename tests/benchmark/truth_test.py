"""The pages and README.md say what the stored runs say."""

import re
import unittest

import support
from dgsfm_benchmark import blocks, page, storage

README = support.PROJECT / "README.md"
MAX_STORED_BYTES = 300_000


class TruthTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.texts = page.render(page.load_results())

    def test_files_are_as_generated(self):
        for path, text in self.texts.items():
            name = path.relative_to(support.PROJECT)
            with self.subTest(str(name)):
                self.assertTrue(path.exists(), f"{name} is missing")
                self.assertEqual(
                    path.read_text().splitlines(),
                    text.splitlines(),
                    "run scripts/benchmark.sh page",
                )

    def test_pages_have_their_runs(self):
        written = {page.PAGE, *storage.RUNS.glob("*.md")}
        stale = [p.name for p in written if p not in self.texts]
        self.assertEqual(stale, [])

    def test_tables_of_results_in_readme_are_blocks(self):
        text = README.read_text()
        self.assertIn("readme", blocks.read_blocks(text))
        rest = re.sub(
            r"<!-- results:.*?<!-- /results -->", "", text, flags=re.DOTALL
        )
        # Figures as of an AUC: "92.0 / 98.4".
        rows = re.findall(r"^\|.*\d\.\d / \d.*$", rest, flags=re.MULTILINE)
        self.assertEqual(rows, [])

    def test_a_wrong_figure_is_found(self):
        (block,) = blocks.read_blocks(self.texts[README]).values()
        figures = re.findall(r"\d+\.\d / \d+\.\d", block)
        self.assertTrue(figures)
        wrong = self.texts[README].replace(figures[0], "99.9 / 99.9", 1)
        contents = {
            name: make(page.load_results())
            for name, make in page.BLOCKS.items()
        }
        self.assertEqual(
            blocks.update_blocks(wrong, contents), self.texts[README]
        )

    def test_links_lead_to_files(self):
        for path, text in self.texts.items():
            for target in re.findall(r"\]\(([^)#:]+)\)", text):
                self.assertTrue(
                    (path.parent / target).exists(), f"{path.name}: {target}"
                )

    def test_stored_runs_are_small(self):
        files = list(storage.RUNS.glob("*.json"))
        total = sum(path.stat().st_size for path in files)
        self.assertLess(total, MAX_STORED_BYTES)
        for path in files:
            longest = max(map(len, path.read_text().splitlines()))
            self.assertLess(longest, 10_000, path.name)


if __name__ == "__main__":
    unittest.main()
