"""A parser of the command line that suggests the nearest command."""

from __future__ import annotations

import argparse
import re
from typing import NoReturn

from fecloth.suggest import did_you_mean


class SuggestingParser(argparse.ArgumentParser):
    """As argparse's, with the nearest valid word for one that is none of the choices."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and the message; exit with status 2."""
        if match := re.search(r"invalid choice: '(.*)' \(choose from (.*)\)", message):
            names = re.findall(r"[\w-]+", match[2])
            words = f"{match[1]!r}: must be one of {', '.join(names)}. "
            message = (words + did_you_mean(match[1], names)).strip()
        super().error(message)
