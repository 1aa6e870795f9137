"""Freezes what `stadera` answers today: about twenty-five commands and their JSON, kept as golden files.

    python benchmarks/golden.py --write FOLDER      runs every case and keeps its JSON
    python benchmarks/golden.py --check FOLDER      runs every case again and prints what moved by more than 1e-9,
                                                    or by --tolerance

A refactoring leaves every figure; a change of the estimators says in its commit which moved and why. Real logs are read
from STADERA_DATA, else ../shared/data; their cases are skipped where there are none.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("STADERA_DATA", ROOT.parent / "shared" / "data"))
STADERA = (sys.executable, "-c", "from stadera.cli import main; main()")
TOLERANCE = 1e-9  # relative
_SKIPPED = ("version", "seconds", "source", "log", "trust")

SIMULATED = {
    "stand": "stand --robot go2 --duration 6 --rate 500 --seed 1",
    "stand-hyq": "stand --robot hyq --duration 5",
    "load-hyq": "stand-load --robot hyq --load 8kg",
    "load-b1": "stand-load --robot b1 --load 5kg",
    "poses": "poses --robot hyq --load 5kg",
    "crawl": "crawl-load --robot hyq --load 8kg --rate 500",
    "crawl-free": "crawl --robot anymal_c --rate 500 --duration 8",
    "trot": "trot-load --robot hyq --load 8kg --rate 1000",
    "trot-go2": "trot-load --robot go2 --load 2kg --rate 500",
    "trot-anymal": "trot --robot anymal_c --rate 500 --duration 6",
    "sway": "shake-load --robot b1 --load 5kg --rate 500",
    "real-trot": "trot-load --robot go2 --load 2kg --errors real --seed 5",
    "real-crawl": "crawl-load --robot aliengo --load 3kg --errors real --seed 6",
    "real-sway": "shake-load --robot a1 --load 2kg --errors real --seed 7",
    "real-stand": "stand-load --robot spot --load 5kg --errors real --seed 8",
}
WEIGHED = {
    "contact-stand": ("stand-hyq", "--method contact"),
    "contact-load": ("load-hyq", "--method contact --tare 0:2"),
    "poses-load": ("load-b1", "--method poses --tare 0:2"),
    "standing-load": ("load-b1", "--method standing --tare 0:2"),
    "combined-poses": ("poses", "--method combined"),
    "poses-poses": ("poses", "--method poses"),
    "walking-stand": ("stand", "--method walking"),
    "walking-crawl": ("crawl", "--method walking --tare 0:2.5"),
    "walking-crawl-free": ("crawl-free", "--method walking"),
    "walking-trot": ("trot", "--method walking --tare 0:2.5"),
    "walking-trot-go2": ("trot-go2", "--method walking --tare 0:2.5"),
    "walking-trot-anymal": ("trot-anymal", "--method walking"),
    "walking-sway": ("sway", "--method walking --tare 0:2.5"),
    "real-trot": ("real-trot", "--tare 0:2 --force"),
    "real-crawl": ("real-crawl", "--tare 0:2 --force"),
    "real-sway": ("real-sway", "--tare 0:2 --force"),
    "real-stand": ("real-stand", "--tare 0:2 --force"),
}
IDENTIFIED = {"go2": "go2_legs_in_air.csv", "aliengo": "aliengo_legs_in_air.csv"}
REPRODUCED = ("table1", "table2")


def run(*arguments: str) -> None:
    """One command of stadera; what goes wrong is told with its last line."""
    done = subprocess.run([*STADERA, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"stadera {' '.join(arguments)}: {done.stderr.strip()[-300:]}")


def commands(out: Path, logs: Path) -> list[list[str]]:
    """All weighings, identifications and experiments; each writes one JSON into `out`."""
    cases = []
    for name, (log, options) in WEIGHED.items():
        robot = SIMULATED[log].split("--robot ")[1].split()[0]
        kept = ["--json", str(out / f"{name}.json")]
        cases.append(["weigh", str(logs / f"{log}.csv"), "--robot", robot, *options.split(), *kept])
    for robot, log in IDENTIFIED.items():
        if (DATA / "real" / log).is_file():
            kept = ["--json", str(out / f"identify-{robot}.json")]
            cases.append(["identify", str(DATA / "real" / log), "--robot", robot, *kept])
    cases += [["reproduce", name, "--quick", "--json", str(out / f"{name}.json")] for name in REPRODUCED]
    return cases


def differences(old: object, new: object, tolerance: float, at: str = "") -> Iterator[str]:
    """Where two JSON values differ by more than the tolerance."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old} - set(_SKIPPED)):  # keys may be added
            if key not in new:
                yield f"{at}.{key}: gone"
            else:
                yield from differences(old[key], new[key], tolerance, f"{at}.{key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from differences(one, other, tolerance, f"{at}[{index}]")
    elif isinstance(old, int | float) and isinstance(new, int | float):
        if not math.isclose(old, new, rel_tol=tolerance, abs_tol=1e-3 * tolerance):
            yield f"{at}: {old:.12g} -> {new:.12g}"
    elif old != new:
        yield f"{at}: {str(old)[:80]} -> {str(new)[:80]}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", type=Path, metavar="FOLDER")
    parser.add_argument("--check", type=Path, metavar="FOLDER")
    parser.add_argument("--only", default="", help="cases whose name contains this")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--tolerance", type=float, default=TOLERANCE, help="relative")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(asked.jobs) as pool:
        logs, out = Path(folder), asked.write or Path(folder) / "out"
        out.mkdir(exist_ok=True, parents=True)
        cases = [case for case in commands(out, logs) if asked.only in Path(case[-1]).stem]
        needed = {Path(case[1]).stem for case in cases if case[0] == "weigh"}
        simulated = [
            ["simulate", "--errors", "standard", *how.split(), "--out", str(logs / f"{name}.csv")]
            for name, how in SIMULATED.items()
            if name in needed
        ]
        list(pool.map(lambda case: run(*case), simulated))
        list(pool.map(lambda case: run(*case), cases))
        if asked.write:
            return 0
        moved = 0
        for case in cases:
            name = Path(case[-1]).name
            if not (asked.check / name).is_file():
                print(f"{name}: a new case")
                continue
            old, new = ((asked.check / name).read_text(), (out / name).read_text())
            found = list(differences(json.loads(old), json.loads(new), asked.tolerance))
            moved += bool(found)
            print(f"{name}: {'as before' if not found else f'{len(found)} figures moved'}")
            for line in found[:12]:
                print("   ", line)
    return int(moved > 0)


if __name__ == "__main__":
    sys.exit(main())
