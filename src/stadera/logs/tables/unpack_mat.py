"""Converts a MATLAB file to a NumPy archive. Run as a script, in a separate process.

On a damaged file SciPy's reader can crash its process, and allocates as much memory as the file states. So it runs in a
process with limits, which imports nothing of this package.
"""

import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def arrays_in(path: str) -> dict[str, NDArray[Any]]:
    """Arrays of a file by name; fields of structs are named struct.field, cells become texts."""
    from scipy import io

    found: dict[str, NDArray[Any]] = {}
    for name, value in io.loadmat(path, chars_as_strings=True).items():
        if not name.startswith("__"):
            _flatten(name, value, found)
    return found


def _flatten(name: str, value: Any, found: dict[str, NDArray[Any]]) -> None:
    array = np.asarray(value)
    if array.dtype.names is not None and array.size == 1:
        for field in array.dtype.names:
            _flatten(f"{name}.{field}", array[field].item(), found)
    elif array.dtype.kind == "O":
        found[name] = np.array([str(np.squeeze(cell)) for cell in array.ravel()])
    elif array.dtype.names is None:
        found[name] = array


def main() -> None:
    """Arguments: the MATLAB file, the archive to write, and limits of memory [bytes] and processor time [s]."""
    path, target, memory, seconds = sys.argv[1:]
    _limit(int(memory), int(seconds))
    try:
        found = arrays_in(path)
    except Exception as error:  # of many kinds, on damaged files
        sys.exit(" ".join(str(error).split())[:200] or type(error).__name__)
    np.savez(target, **found)  # type: ignore[arg-type]


def _limit(memory: int, seconds: int) -> None:
    with suppress(ImportError, OSError, ValueError):  # if the system has no such limits
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))


if __name__ == "__main__":
    main()
