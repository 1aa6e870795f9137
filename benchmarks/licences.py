"""Lists the licences of all that the lock file of the runtime installs, and fails on a copyleft one.

python benchmarks/licences.py
"""

from __future__ import annotations

import re
import sys
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

LOCK = Path(__file__).resolve().parent.parent / "requirements" / "runtime.lock"
COPYLEFT = re.compile(r"\bA?GPL|General Public License", re.IGNORECASE)
LESSER = re.compile(r"\bLGPL|Lesser", re.IGNORECASE)


def licence(package: str) -> str:
    """What a package's own metadata say, in one line."""
    found = metadata(package)
    classifiers = [c.split(" :: ")[-1] for c in found.get_all("Classifier") or [] if c.startswith("License")]
    stated = found.get("License-Expression") or "; ".join(classifiers) or (found.get("License") or "").strip()
    return stated.splitlines()[0][:80] if stated else "not stated"


def main() -> int:
    refused = 0
    for package in sorted(set(re.findall(r"^([a-zA-Z0-9_.-]+)==", LOCK.read_text(), re.MULTILINE))):
        try:
            stated = licence(package)
        except PackageNotFoundError:
            print(f"{package:28} not installed here")
            continue
        bad = bool(COPYLEFT.search(stated)) and not LESSER.search(stated)
        refused += bad
        print(f"{package:28} {stated}{'   <- copyleft' if bad else ''}")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
