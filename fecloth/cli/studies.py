"""Run a study of the table of commands; and print the modes of a scene."""

import hashlib
import re
from argparse import Namespace
from pathlib import Path

from fecloth.cli.commands import RUNNING, Command, reading

# Characters of the question in the name of a folder. With the scene and a hash the name is then
# far below the 255 bytes that file systems allow.
LONGEST_QUESTION = 80
SHARED = {"scene", "set", *RUNNING}  # the other options of a study are its own arguments


def run_study(command: Command, options: Namespace) -> int:
    """Run the study, print its result and write its report; return the exit status.

    `compare` of the folders of two runs is no study: it draws both runs in one picture.
    """
    from fecloth.study import threads  # noqa: F401, I001  before NumPy: one thread a case
    from fecloth.scene.scene import load_scene
    from fecloth.study.overlay import compare_runs
    from fecloth.study.work import LONGEST

    if isinstance(options.scene, list):
        paths = options.scene
    else:
        paths = [options.scene]
    stem = "-".join(Path(path).stem for path in paths)
    name = command.target.rpartition(":")[2]  # the function, after which folders are named
    own_options = {option.key for option in command.options} - SHARED
    folder = Path(options.output or Path("out") / name / (stem + _question(command, options)))
    if len(paths) == 2 and all(Path(path).is_dir() for path in paths):  # two runs, for compare
        first, second = paths
        print(f"wrote {compare_runs(first, second, folder / 'overlay')}")
        return 0
    arguments = {key: getattr(options, key) for key in own_options}
    if "set" in (option.key for option in command.options):
        scenes = [load_scene(path, options.set, trust_geo=options.trust_geo) for path in paths]
    else:  # the file names scenes, which the study reads
        scenes = paths
        arguments["trust_geo"] = options.trust_geo
    study = command.load()
    result = study(
        scenes[0] if len(scenes) == 1 else scenes,
        **arguments,
        cache=options.output or "out",  # without -o all commands share the finished cases
        jobs=options.jobs,
        scheduler=options.scheduler,
        time_limit=options.time_limit,
        most_seconds=None if options.yes else LONGEST,  # a longer study needs --yes
        fresh=options.fresh,
    )
    print(result.summary())
    print(result.describe_files(folder, result.report(folder)))
    return result.exit_status


def _question(command: Command, options: Namespace) -> str:
    """Return the options that are not defaults as a text for the name of the study's folder.

    So different questions have different folders. It is "" if all are defaults, and else begins
    with a comma. Options that do not change the result, such as --jobs, do not count.
    """
    parts = []
    for option in command.options:
        value = getattr(options, option.key)
        if option.key not in SHARED - {"set"} and value != option.keywords.get("default"):
            items = value if isinstance(value, list) else [value]
            parts += [f"{option.key}={item}" for item in items if item]
    if not parts:
        return ""
    text = ",".join(parts)
    name = re.sub(r"[^\w.=,+-]", "_", text)  # characters that any file system allows
    # A hash keeps apart texts that have become the same name.
    if name != text or len(name) > LONGEST_QUESTION:
        name = f"{name[:LONGEST_QUESTION]}-{hashlib.sha256(text.encode()).hexdigest()[:6]}"
    return f",{name}"


def print_modes(options: Namespace) -> int:
    """Print the frequencies [Hz], one a line, and return the exit status 0.

    Warnings and the verdict go to standard error. With a folder write report, picture and
    shapes.
    """
    import sys
    import warnings

    from fecloth.cli.progress import terminal
    from fecloth.errors import FeclothWarning
    from fecloth.scene.scene import load_scene
    from fecloth.study.study import of

    study = of(load_scene(options.scene, options.set, **reading(options)))
    with warnings.catch_warnings():  # they are printed below
        warnings.simplefilter("ignore", FeclothWarning)
        result = study.modes(count=options.count)
    for frequency in result.frequencies:
        print(f"{frequency:.6g}")
    for words in result.warnings:
        print(f"warning: {words}", file=sys.stderr)
    console = terminal(options.quiet)
    console.print(result.verdict, soft_wrap=True)
    if options.output:
        console.print(f"wrote {result.report(options.output)}", soft_wrap=True)
        console.print(f"open {result.write(options.output)} in ParaView", soft_wrap=True)
    return 0
