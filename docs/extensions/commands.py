"""The list of commands, from the parser of the command line."""

from argparse import Action, ArgumentParser, HelpFormatter

from generated import Generated
from sphinx.application import Sphinx

from fecloth.cli import main as cli


class Commands(Generated):
    """A section for each command: what it does, how it is called, its options."""

    def text(self) -> str:
        parsers = next(a for a in cli._parser()._actions if a.dest == "command").choices
        parts = [section(name, parser) for name, parser in parsers.items()]
        return "\n".join([*parts, "Exit status", "-----------", "", "::", "", indented(cli.STATUS)])


def section(name: str, parser: ArgumentParser) -> str:
    words = str(parser.description)
    title = f"fecloth {name}"
    # argparse folds at the width of a terminal, which is not the width of a page
    usage = " ".join(parser.format_usage().removeprefix("usage: ").split())
    lines = [title, "-" * len(title), "", f"{words[0].upper()}{words[1:]}.".replace("_", r"\_"), ""]
    lines += ["::", "", f"   {usage}", ""]
    for action in parser._actions:
        if action.dest != "help":
            lines += [f"``{spelling(action)}``", f"   {meaning(action, parser.prog)}", ""]
    return "\n".join(lines)


def spelling(action: Action) -> str:
    """Return the names of an option and of its value, as a reader types them."""
    choices = "|".join(map(str, action.choices or ()))
    value = "" if action.nargs == 0 else str(action.metavar or choices or action.dest)
    value = value if action.option_strings else value or action.dest
    return " ".join([*action.option_strings, value]).strip()


def meaning(action: Action, prog: str) -> str:
    words = HelpFormatter(prog)._expand_help(action) if action.help else "see the other commands"
    for letter in r"\*_`|":
        words = words.replace(letter, f"\\{letter}")
    return words


def indented(text: str) -> str:
    return "\n".join(f"   {line}" for line in text.splitlines())


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True}
