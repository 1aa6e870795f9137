"""The command line: parses, calls a pure function, prints. One module a command.

Exit codes: 0 done; 1 an error of the user's, told in one line; 2 bad usage. Any other exception is a fault of the
program and shows its traceback.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command that the arguments (None: the process's) name, and exit.

    Raises:
        SystemExit: with the exit code.
    """
    from stadera.cli.app import app
    from stadera.errors import StaderaError

    try:
        app(args=arguments, prog_name="stadera")
    except StaderaError as error:
        print(f"stadera: error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(1)
