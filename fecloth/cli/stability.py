"""The command `fecloth stability`."""

from __future__ import annotations

import argparse

from fecloth.cli.studies import add_study_options, folders, how_to_run, read_names


def add_stability_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fecloth stability`."""
    add = parser.add_argument
    add("scene", help="a .toml file")
    values = "values of a key: KEY=a:b:log:n, KEY=a:b:lin:n or KEY=v1,v2; may be repeated"
    add("--over", action="append", metavar="KEY=VALUES", help=values)
    text = "as bdf2,central_difference, with commas (default: eight)"
    add("--methods", type=read_names, metavar="A,B", help=text)
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="replace a value")
    add_study_options(parser, "stability", 120.0)


def run_stability(options) -> int:
    """Run the scene with each method and step, print the table, write the report."""
    from fecloth.scene.scene import load_scene
    from fecloth.study.stability_map import stability

    folder, cache = folders(options, "stability")
    found = stability(
        load_scene(options.scene, options.set, trust_geo=options.trust_geo),
        options.over,
        options.methods,
        **how_to_run(options, cache),
    )
    print("\n".join([found.verdict, *found.notes(), "", str(found.table), ""]))
    print(f"wrote {found.report(folder)}")
    return 3 if found.has_stopped else 0
