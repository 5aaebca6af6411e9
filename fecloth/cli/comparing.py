"""The command `fecloth compare`."""

from __future__ import annotations

import argparse
from pathlib import Path

from fecloth.cli.studies import add_study_options, folders, how_to_run


def add_compare_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fecloth compare`."""
    add = parser.add_argument
    add(
        "scenes",
        nargs="+",
        metavar="scene",
        help="a .toml file; several without --variants; or the folders of two runs",
    )
    text = "values of a key, as terms.0.type=StVK,Springs; may be repeated"
    add("--variants", action="append", metavar="KEY=VALUES", help=text)
    text = 'what is compared, as "max tip.z" (default: the first of [interest])'
    add("--quantity", metavar="Q", help=text)
    add("--refine", choices=("h", "dt", "both"), default="h", help="what is refined (h)")
    add("--levels", type=int, default=3, metavar="N", help="from 3 to 10 (3)")
    add("--ratio", type=float, metavar="R", help="h or dt of a level over the next (2 or √2)")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="replace a value")
    add_study_options(parser, "compare")


def run_compare(options) -> int:
    """Compare the variants or the scenes, print the verdict and the table, write the report.

    Of the folders of two runs only write the difference.
    """
    from fecloth.errors import InputError
    from fecloth.scene.scene import load_scene
    from fecloth.study.comparing import compare
    from fecloth.study.overlay import compare_runs

    options.scene = "-".join(Path(one).stem for one in options.scenes)  # names the folder
    folder, cache = folders(options, "compare")
    if len(options.scenes) == 2 and all(Path(one).is_dir() for one in options.scenes):
        a, b = options.scenes
        print(f"wrote {compare_runs(a, b, folder / 'overlay')}")
        return 0
    if (len(options.scenes) == 1) != bool(options.variants):
        remedy = "For example --variants terms.0.type=StVK,Springs."
        raise InputError("compare", "takes one scene with --variants, or several", "", remedy)
    scenes = [load_scene(one, options.set, trust_geo=options.trust_geo) for one in options.scenes]
    found = compare(
        scenes if options.variants is None else scenes[0],
        options.variants,
        options.quantity,
        options.refine,
        options.levels,
        ratio=options.ratio,
        **how_to_run(options, cache),
    )
    print("\n".join([found.verdict, *found.notes(), "", str(found.table), ""]))
    page = found.report(folder)
    if found.overlay:
        print(f"wrote {folder / 'overlay' / 'first.pvd'}")
    print(f"wrote {page}")
    return 3 if any(row["status"] != "ok" for row in found.table) else 0
