"""The parsers of the commands."""

from argparse import ArgumentParser


def commands_of(parser: ArgumentParser) -> dict[str, ArgumentParser]:
    """Return the parser of each command by its name."""
    (commands,) = (action for action in parser._actions if action.dest == "command")
    return dict(commands.choices)
