"""The command `fecloth chart`."""

from __future__ import annotations

import argparse

from fecloth.cli.studies import add_study_options, folders, how_to_run, read_names


def add_chart_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fecloth chart`."""
    add = parser.add_argument
    add("scene", help="a .toml file")
    text = 'what is compared, as "max tip.z" (default: the first of [interest])'
    add("--quantity", metavar="Q", help=text)
    names = "{}, with commas (default: {})"
    own = "the scene's own and the usual others"
    add("--methods", type=read_names, metavar="A,B", help=names.format("as bdf2,newmark", own))
    add("--elements", type=read_names, metavar="A,B", help=names.format("of P1,P2", "both"))
    text = names.format("as StVK,NeoHookean", "the scene's own")
    add("--models", type=read_names, metavar="A,B", help=text)
    add("--meshes", type=int, default=2, metavar="N", help="meshes with h, h/2, … (2)")
    add("--levels", type=int, default=3, metavar="N", help="of the limit, from 3 (3)")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="replace a value")
    add_study_options(parser, "chart", 60.0)


def run_chart(options) -> int:
    """Run the scene with other settings, print the verdict and the front, write the report."""
    from fecloth.scene.scene import load_scene
    from fecloth.study.charts import chart

    folder, cache = folders(options, "chart")
    found = chart(
        load_scene(options.scene, options.set, trust_geo=options.trust_geo),
        options.quantity,
        options.methods,
        options.elements,
        options.models,
        meshes=options.meshes,
        levels=options.levels,
        **how_to_run(options, cache),
    )
    print("\n".join([found.verdict, *found.notes(), "", str(found.front), ""]))
    print(f"These are {len(found.front)} of {len(found.table)} settings: no other is as accurate")
    print("at the same cost. The report has all.")
    print(f"wrote {found.report(folder)}")
    return 0 if len(found.front) else 3
