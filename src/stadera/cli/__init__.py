"""Command line: parses arguments, calls a pure function, prints. One module for each command.

Exit codes: 0 done; 1 a user's error or a result that cannot be trusted, in one line; 2 bad usage. Any other exception
is a bug: one line says how to report it, and `--debug` (or STADERA_DEBUG=1) shows the traceback.
"""

import gc
import os
import sys
from collections.abc import Sequence

DEBUG = "--debug"
"""Accepted anywhere on the command line."""
INTERRUPTED = 130
"""Exit code after Ctrl-C, as of a shell."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command given by the arguments (None: the process's), and exits with the exit code."""
    if arguments is None:  # not called by another program
        from stadera.process import collect_rarely

        collect_rarely()
    from stadera.cli.app import app
    from stadera.cli.terminal import prepare_streams
    from stadera.errors import StaderaError

    prepare_streams()
    given = list(sys.argv[1:] if arguments is None else arguments)
    code: str | int | None = 0
    debug = DEBUG in given or os.environ.get("STADERA_DEBUG", "0") not in ("", "0")
    try:
        app(args=[argument for argument in given if argument != DEBUG], prog_name="stadera")
    except SystemExit as ended:
        code = ended.code
    except Exception as error:
        if debug:
            raise
        said = " ".join(_printable(str(error)).split())
        if not isinstance(error, StaderaError):
            said = (
                f"internal error, {type(error).__name__}: {said}; please report it with the traceback that the same "
                f"command prints with {DEBUG}"
            )
        print(f"stadera: error: {said}", file=sys.stderr)
        code = 1
    if code == INTERRUPTED:
        gc.collect()  # what the interrupted frames held, else solvers report it as leaked
    sys.exit(code)


def _printable(text: str) -> str:
    """Escapes characters that a terminal would interpret, since names in messages come from files."""
    return "".join(c if c.isprintable() or c.isspace() else c.encode("unicode_escape").decode() for c in text)
