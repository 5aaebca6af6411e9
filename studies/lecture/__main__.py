"""All pages of the lecture: their checks, and their figures as DIR/NAME.png.

    python -m studies.lecture [NAME ...] [-o DIR] [--quick]

A page is named by its number, "01", or by its file, "01_mesh_in_time".
"""

from __future__ import annotations

import runpy
import time
from pathlib import Path

from fecloth.errors import MISSED, InputError
from studies import harness

PAGES = {path.stem: path for path in sorted(Path(__file__).parent.glob("[0-9]*.py"))}
QUICK = ("01", "06")  # the pages of --quick


def chosen(names: list[str]) -> list[str]:
    """Return the pages of these names or numbers, all without any."""
    for name in names:
        if not any(name in (page, page[:2]) for page in PAGES):
            raise InputError(f"page {name}", f"must be one of {', '.join(PAGES)}", "lecture")
    return [page for page in PAGES if not names or {page, page[:2]} & set(names)]


def run_page(page: str) -> dict:
    """Run a page without a window and return its variables; `fig` is its figure."""
    import matplotlib.pyplot as plt

    with plt.rc_context():
        plt.switch_backend("agg")
        try:
            return runpy.run_path(str(PAGES[page]))
        finally:
            plt.close("all")


def main() -> int:
    """Run the pages and write their figures; 1 if a check failed."""
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="pages, such as 01 (all)")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/lecture"), metavar="DIR")
    parser.add_argument("--quick", action="store_true", help=f"the pages {' and '.join(QUICK)}")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    failed = 0
    for page in chosen(options.names or (list(QUICK) if options.quick else [])):
        start = time.process_time()
        try:
            run_page(page)["fig"].savefig(options.out / f"{page}.png")
            said = "checked"
        except AssertionError as error:
            line = error.__traceback__
            while line.tb_next:
                line = line.tb_next
            said, failed = f"check failed in line {line.tb_lineno} {error}".strip(), failed + 1
        print(f"{page:<24} {time.process_time() - start:5.1f} s  {said}")
    print(f"{failed} checks failed; figures in {options.out}")
    return MISSED if failed else 0


if __name__ == "__main__":
    harness.run_main(main)
