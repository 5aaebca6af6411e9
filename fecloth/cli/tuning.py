"""The command `fecloth tune`."""

from __future__ import annotations

import argparse

from fecloth.cli.studies import (
    add_scene_options,
    add_study_options,
    add_tolerance,
    folders,
    how_to_run,
    read_names,
)


def add_tune_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fecloth tune`."""
    add_scene_options(parser)
    add_tolerance(parser, "error")
    add = parser.add_argument
    text = 'longest CPU time of the tuned run, as "60 s": seek the most accurate setting within it'
    add("--budget", metavar="TIME", help=text)
    text = "leave out terms, or take cheaper ones, where that changes little"
    add("--model", action="store_true", help=text)
    names = "{}, with commas (default: {})"
    own = "the scene's own and the usual others"
    add("--methods", type=read_names, metavar="A,B", help=names.format("as bdf2,newmark", own))
    add("--elements", type=read_names, metavar="A,B", help=names.format("of P1,P2", "both"))
    add_study_options(parser, "tune")


def run_tune(options) -> int:
    """Find the cheapest setting of the scene, print it, write the report and tuned.toml."""
    from fecloth.scene.scene import load_scene
    from fecloth.study.tuning.tune import tune

    folder, cache = folders(options, "tune")
    found = tune(
        load_scene(options.scene, options.set, trust_geo=options.trust_geo),
        options.tolerance,
        options.quantity,
        budget=_seconds(options.budget),
        model=options.model,
        methods=options.methods,
        elements=options.elements,
        folder=folder,
        **how_to_run(options, cache),
    )
    print("\n".join([found.verdict, *found.notes(), "", str(found.table), ""]))
    print(f"wrote {found.report(folder)} and {found.scene}")
    return 0 if found.proved else 1


def _seconds(text: str | None) -> str | float | None:
    """Return a bare number as seconds, and a text with a unit as it is."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return text
