"""Writes what the guides say to expect, and the outputs of the notebooks: python docs/outputs.py (some minutes; needs
pip install '.[lab,models,docs]'); python docs/outputs.py notebooks writes only these.

The commands of OUTPUTS run in a temporary folder, on the logs that LOGS simulate; the lines of theirs that match stand
between `<!-- begin out_NAME -->` and `<!-- end out_NAME -->` of a page. MOTIONS is the table of bars by motion.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from stadera.report.numbers import with_std

FOLDER = Path(__file__).parent
GO2 = "--robot go2 --errors real-unit-gain --rate 500 --load 1.6kg --load-time 10 --duration 20"
LOGS = (
    f"simulate trot-load {GO2} --out walk.parquet",
    f"simulate stand-load {GO2} --out standing.parquet",
    f"simulate shake-load {GO2} --out swaying.parquet",
    "simulate trot-load --robot hyq --rate 500 --load 8kg --duration 6 --out trot.csv",
    "simulate stand-load --robot hyq --out stand.csv",
    "simulate shake --robot g1 --arms 0.3 --load 2kg --on left_wrist_yaw_link --at 0.05,0,0.02 --out g1.csv",
    "excite --robot go2 --trunk --out routine.csv",
    "simulate motion --motion routine.csv --robot go2 --load 1.6kg --errors real --out routine.parquet",
)
WEIGHED = r"^ (trunk |payload |about )|^ +[\d.]+ +[\d.]+ +(on|off)|^Payload"
OUTPUTS = {
    "start": (
        "weigh trot.csv --robot hyq --tare 0:2.4 --truth trot.truth.json",
        r"^ (trunk frame|trunk, CAD|trunk with|payload |truth: payload)",
    ),
    "inspect": ("inspect walk.parquet --robot go2", r"^(time|rate|joints|imu|nothing)"),
    "go2": ("weigh walk.parquet --robot go2 --tare 0:9.5", WEIGHED),
    "routine": ("weigh routine.parquet --robot go2 --tare 0:4", r"^ (trunk frame|payload )|^Payload"),
    "excite": ("excite --robot go2 --trunk --out again.csv", "^A payload"),
    "g1": ("weigh g1.csv --robot g1 --imu-frame imu_in_pelvis --tare 0:3", "^ payload |by odds"),
    "standing": (
        "weigh stand.csv --robot hyq --method standing --tare 0:4 --truth stand.truth.json",
        "^ (trunk frame|payload |truth: payload)|^Payload",
    ),
    "swing": ("identify go2_legs_in_air --robot go2", "^ joint +torque RMS|^ all joints"),
    "live": ("live replay:walk.parquet --robot go2 --tare 9", r"^\d+\.\d+ s: "),
    "fleet": ("fleet walk.parquet standing.parquet swaying.parquet --robot go2 --out runs.parquet", "^ (robot|go2) "),
    "identify": ("identify go2_legs_in_air --robot go2", r"^Trust|below CAD with fitted friction\.$"),
    "own": (
        f"weigh stand.csv --robot hyq --method {FOLDER.parent}/examples/own_estimator.py:MeanMass",
        "^Trunk with all",
    ),
}
"""A command and the lines that are shown, by the name between the marks."""

MOTIONS = {"standing": "standing.parquet", "swaying": "swaying.parquet", "walking": "walk.parquet"}


def printed(command: str, folder: Path) -> str:
    """What `stadera COMMAND` prints, on lines as long as they need be."""
    environment = os.environ | {"NO_COLOR": "1", "COLUMNS": "300"}
    words = [sys.executable, "-m", "stadera", *shlex.split(command)]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=True).stdout


def shown(text: str, pattern: str) -> str:
    """The lines that match, as a block of code."""
    lines = [line.rstrip() for line in text.splitlines() if re.search(pattern, line)]
    return "\n" + "\n".join(f"    {line.removeprefix(' ')}" for line in lines) + "\n"


def motions(folder: Path) -> str:
    """The payload and its bars by motion, one row each."""
    rows = ["| motion | payload [kg] | com x [m] | com y [m] | com z [m] |", "|---|---|---|---|---|"]
    for motion, log in MOTIONS.items():
        text = printed(f"weigh {log} --robot go2 --tare 0:9.5", folder)
        (found,) = re.findall(r"payload since the tare +(.*)", text)
        rows.append(f"| {motion} | {' | '.join(re.split(r'   +', found.strip()))} |")
    return "\n".join(rows)


def drives(folder: Path) -> str:
    """Rotor inertia and friction of a leg's joints, one row each."""
    printed("identify go2_legs_in_air --robot go2 --json go2.json", folder)
    rows = ["| joint | armature [kg·m²] | viscous [N·m·s/rad] | coulomb [N·m] |", "|---|---|---|---|"]
    for joint, found in json.loads((folder / "go2.json").read_text())["joints"].items():
        if joint.startswith("FL"):
            terms = (found[name] for name in ("armature", "viscous", "coulomb"))
            cells = ("not measured" if t["std"] is None else with_std(t["value"], t["std"]) for t in terms)
            rows.append(f"| {joint} | {' | '.join(cells)} |")
    return "\n".join(rows)


def notebooks() -> None:
    """Runs the notebooks and keeps their outputs in them."""
    import nbformat
    from nbclient import NotebookClient

    for path in sorted((FOLDER.parent / "examples" / "notebooks").glob("*.ipynb")):
        book = nbformat.read(path, as_version=4)
        NotebookClient(book, record_timing=False, resources={"metadata": {"path": str(path.parent)}}).execute()
        book.metadata.language_info = {"name": "python"}  # without the version of who ran it
        nbformat.write(book, path)


def main() -> None:
    notebooks()
    if sys.argv[1:] == ["notebooks"]:
        return
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for command in LOGS:
            printed(command, folder)
        blocks = {name: shown(printed(command, folder), lines) for name, (command, lines) in OUTPUTS.items()}
        blocks |= {"motions": motions(folder), "drives": drives(folder)}
    for page in FOLDER.rglob("*.md"):
        text = old = page.read_text(encoding="utf-8")
        for name, block in blocks.items():
            marks = rf"(<!-- begin out_{name} -->\n).*?(<!-- end out_{name} -->)"
            text = re.sub(marks, lambda found, block=block: f"{found[1]}{block}\n{found[2]}", text, flags=re.DOTALL)
        if text != old:
            page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
