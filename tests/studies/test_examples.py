"""The three examples of what a user may write: short, and as the page of terms shows them."""

import re

from support.examples import FILES, FOLDER


def test_the_page_of_terms_shows_the_law_as_it_is():
    page = FOLDER.parents[1] / "fecloth" / "terms" / "README.md"
    law = next(path for path in FILES if "law" in path.stem).read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    assert block in law
