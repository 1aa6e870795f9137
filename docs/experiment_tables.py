"""Writes tables of the pages in PAGES from the runs' JSON: python docs/experiment_tables.py [REALITY_JSON]

A run's JSON is docs/results/NAME.json, as `stadera reproduce NAME --json docs/results/NAME.json` writes it, or of peers
`python benchmarks/peers.py --json docs/results/peers.json`, or of the demo a list of what `stadera demo --seed N --json
F` writes, less `runs`. REALITY_JSON is that of `stadera reproduce reality`; what the page shows is kept. Each table
stands between `<!-- begin NAME -->` and `<!-- end NAME -->`; what is around stays as it is. `ran_NAME` there stands for
the run's command, date and commit. This program notes them in docs/results/runs.json when a file has changed:
today, and the commit that is checked out.
"""

from __future__ import annotations

import datetime
import json
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

from stadera.report.numbers import short

FOLDER = Path(__file__).parent
REPLAYS = ("replay_go2", "replay_go2_commands", "replay_aliengo", "replay_aliengo_commands")
STUDIES = ("reality_table", "ablation", "mini_cheetah", "faults", "faults_arms", "humanoids", "identified", "alarms")
PAGES = sorted((FOLDER / "validation").glob("*.md"))
RESULTS = FOLDER / "results"
Record = dict[str, Any]
Naming = Callable[[Record], str]

PAPER = ("table1", "fig4", "fig5", "table2", "table3", "fig6", "table5", "table4", "inertial_share")
"""The paper's tables and figures."""

COMMANDS = {
    "demo": "for N in $(seq 0 19); do stadera demo --seed $N --json demo-$N.json; done",
    "peers": "python benchmarks/peers.py --json docs/results/peers.json",
    "ablation": "python benchmarks/ablation.py LOGS --seed 7100 --walks FOLDER",
    "reality_table": "stadera reproduce reality --seed 971 --seeds 1 --json reality.json\n"
    "    python docs/experiment_tables.py reality.json",
    "mini_cheetah": "stadera reproduce mini_cheetah FOLDER --json docs/results/mini_cheetah.json",
    "humanoids": "stadera reproduce humanoids --quick --seeds 3 --seed 30 --json docs/results/humanoids.json",
    "identified": "stadera reproduce identified --quick --json docs/results/identified.json",
    "faults": "stadera reproduce faults --robots a1,anymal_b,anymal_c,b1,go2,hyq --seeds 1 --seed 83 --json "
    "docs/results/faults.json",
    "faults_arms": "stadera reproduce faults --robots b1_z1,g1,talos --seeds 1 --seed 83 --json "
    "docs/results/faults_arms.json",
    "replay_go2": "stadera replay go2_legs_in_air --robot go2.json --against go2 --json docs/results/replay_go2.json",
}
"""What makes a run's JSON, where it is not `stadera reproduce NAME`."""


def ran(name: str) -> str:
    """Command, date and commit of a run that is kept."""
    kept = noted()[name]
    day = datetime.date.fromisoformat(kept["date"])
    command = COMMANDS.get(name, f"stadera reproduce {name} --json docs/results/{name}.json")
    return f"\n    {command}\n\nRun on {day.day} {day:%B %Y}, commit {kept['commit']}."


def noted() -> dict[str, dict[str, str]]:
    """Hash, date and commit of each run, as they were noted."""
    return dict(json.loads((RESULTS / "runs.json").read_text(encoding="utf-8")))


def hashes() -> dict[str, str]:
    """SHA-256 of each run's JSON as it is now."""
    return {
        path.stem: sha256(path.read_bytes()).hexdigest()
        for path in sorted(RESULTS.glob("*.json"))
        if path.stem != "runs"
    }


def note() -> None:
    """Notes today and the present commit of every run whose JSON has changed."""
    known = noted()
    head = subprocess.run(["git", "rev-parse", "--short=7", "HEAD"], cwd=FOLDER, capture_output=True, check=True)
    new = {"date": datetime.date.today().isoformat(), "commit": head.stdout.decode().strip()}
    kept = {
        name: known[name] if known.get(name, {}).get("sha256") == now else {"sha256": now, **new}
        for name, now in hashes().items()
    }
    (RESULTS / "runs.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def overview() -> str:
    """One row a command: how many of its bounds were met."""
    lines = ["| command | bounds met |", "|---|---|"]
    for name in PAPER:
        bounded = [record["met"] for record in read(name) or () if record["met"] is not None]
        none = "no run kept" if read(name) is None else "no bounds"
        met = f"{sum(bounded)} of {len(bounded)}" if bounded else none
        lines.append(f"| `stadera reproduce {name}` | {met} |")
    return "\n".join(lines)


def peers() -> str:
    """As `benchmarks/peers.py` prints them."""
    sys.path.insert(0, str(FOLDER.parent / "benchmarks"))
    from peer_tables import markdown

    record: dict[str, Any] = json.loads((RESULTS / "peers.json").read_text(encoding="utf-8"))
    return markdown(record)


def crossed(records: Iterable[Record], row: Naming, column: Naming, corner: str) -> str:
    """A table of values, the paper's in brackets, ✗ for a bound that is missed."""
    cells: dict[str, dict[str, str]] = {}
    for record in records:
        cells.setdefault(row(record), {})[column(record)] = cell(record)
    return table(cells, corner)


def cell(record: Record) -> str:
    """Value, unit where it is one, the paper's value, and whether a bound is missed."""
    paper = "" if record["paper"] is None else f" ({short(record['paper'])})"
    return f"{short(record['value'])}{paper}{' ✗' if record['met'] is False else ''}"


def case(*names: str) -> Naming:
    """The values of a case by name, and of "metric" the metric with its unit."""

    def named(record: Record) -> str:
        unit = "" if record["unit"] == "1" else f" [{record['unit']}]"
        known = record["case"] | {"metric": f"{record['metric']}{unit}"}
        said = ", ".join(f"{known[name]:g}" if isinstance(known[name], float) else known[name] for name in names)
        return said.replace("|", "\\|")  # which would end the cell

    return named


def tables(name: str, records: list[Record]) -> Iterator[str]:
    """The tables of one experiment."""
    compared = [r for r in records if r["paper"] is not None or r["bound"] is not None]
    if name == "table1":
        kinds = [r for r in compared if "method" in r["case"]]
        yield crossed(kinds, case("metric"), case("perturbation", "sensor errors", "method"), "here (paper)")
    elif name == "fig4":
        yield crossed(records, case("sensor errors", "metric"), case("joint"), "sensor errors")
    elif name == "fig5":
        yield real_legs([r for r in records if "joint" in r["case"]])
    elif name == "fig6":
        yield crossed(records, case("settling time asked for [s]"), case("metric"), "settling time [s]")
    elif name == "table2":
        yield crossed(compared, case("method", "metric"), case("load [N]"), "load [N]")
        others = [r for r in records if r["case"]["robot"] != "hyq" and r["metric"].endswith("in x-y")]
        yield crossed(others, case("robot", "metric"), case("load, share of the weight"), "load, share of the weight")
    elif name == "table3":
        ways = "; ".join(dict.fromkeys(r["metric"].removeprefix("‖δ‖ in the ") for r in compared))
        yield f"‖δ‖ [cm] in {ways} (paper):"
        yield joined(compared, slope, case("load [N]"), "slope; load [N]")
    elif name == "table4":
        for error in dict.fromkeys(r["case"]["error"] for r in compared):
            chosen = [r for r in compared if r["case"]["error"] == error]
            μ, σ = (next(key for key in chosen[0]["case"] if key.startswith(letter)) for letter in "μσ")
            ways = "; ".join(dict.fromkeys(map(short_reading, chosen)))
            yield f"{error[0].upper()}{error[1:]}: ‖δ‖ in x-y [cm], {ways} (paper):"
            yield joined(chosen, case("method"), case(μ, σ), f"{μ}, {σ}")
    elif name == "mini_cheetah":
        yield crossed(records, case("metric"), lambda _: "ten walks, two in the air", "")
    elif name == "identified":
        yield whole_robots(records)
    elif name == "alarms":
        shown = [r for r in records if r["metric"] != "falls" or r["value"]]
        yield crossed(shown, case("errors", "motion"), case("metric"), "errors, motion")
    elif name == "humanoids":
        yield crossed(records, case(*records[0]["case"]), case("metric"), ", ".join(records[0]["case"]))
    elif name.startswith("faults"):
        yield crossed(records, case("metric"), case(*records[0]["case"]), "fault")
    else:
        (key,) = records[0]["case"]
        yield crossed(records, case("metric"), case(key), key)


def whole_robots(records: list[Record]) -> str:
    """By quantity and logs: median error, share that was determined, and share within two standard deviations."""
    found = {(r["case"]["logs"], *r["metric"].split(": ")): r for r in records if ": " in r["metric"]}
    cells: dict[str, dict[str, str]] = {}
    for (logs, name, part), record in found.items():
        if part.startswith("median error"):
            shares = [found.get((logs, name, share)) for share in ("determined", "within 2 σ")]
            also = ["–" if share is None else cell(share) for share in shares if any(shares)]
            row = f"{name}{re.sub(',? of the', ',', re.sub('median error(, relative)?', '', part))} [{record['unit']}]"
            cells.setdefault(row, {})[logs] = "; ".join([cell(record), *also])
    return f"Median error; determined; within 2 σ [%]:\n\n{table(cells, '')}"


def slope(record: Record) -> str:
    """Slope of Table III."""
    return f"{record['case']['slope [deg]']:g}°"


def short_reading(record: Record) -> str:
    """Reading of Table IV in a few words."""
    readings = {"measured, constant over a run": "constant", "measured, new in every sample": "every sample"}
    return readings.get(record["case"]["reading"], "controller misled")


def joined(records: Iterable[Record], row: Naming, column: Naming, corner: str) -> str:
    """A table of several values a cell, the paper's, which they have in common, in brackets."""
    found: dict[str, dict[str, list[Record]]] = {}
    for record in records:
        found.setdefault(row(record), {}).setdefault(column(record), []).append(record)
    cells = {
        name: {
            key: "; ".join(cell(r | {"paper": None}) for r in own)
            + ("" if own[0]["paper"] is None else f" ({short(own[0]['paper'])})")
            for key, own in columns.items()
        }
        for name, columns in found.items()
    }
    return table(cells, corner)


def real_legs(records: list[Record]) -> str:
    """Means over the four legs by robot and kind of joint; the figure has every joint."""
    cells: dict[str, dict[str, str]] = {}
    for robot, part in dict.fromkeys((r["case"]["robot"], r["case"]["joint"].split("_")[1]) for r in records):
        own = [r for r in records if r["case"]["robot"] == robot and f"_{part}_" in r["case"]["joint"]]
        for metric in dict.fromkeys(r["metric"] for r in own):
            values = [r["value"] for r in own if r["metric"] == metric]
            cells.setdefault(f"{robot}, {part}", {})[f"{metric} [N·m]"] = short(sum(values) / len(values))
    return table(cells, "mean of four legs")


SHOWN = {
    "payload": "payload mass",
    "place": "payload x-y",
    "trunk": "trunk mass",
    "centre": "trunk CoM x-y",
    "height": "trunk CoM z",
}
"""Of the study of reality, by the names of its short table."""


def keep(run: Path) -> None:
    """Writes `reality_table.json`: what the page shows of the run; the whole is larger than the documentation keeps."""
    old = json.loads((RESULTS / "reality_table.json").read_text(encoding="utf-8"))
    found: dict[tuple[str, str, str], float] = {}
    for record in json.loads(run.read_text(encoding="utf-8")):
        case = record["case"]
        if case.get("errors") == old["errors"] and "scenario" in case:
            found[case["scenario"], case["method"], record["metric"]] = record["value"]
    rows = []
    for motion, method in dict.fromkeys((motion, method) for motion, method, _ in found if method in ("walking", "ls")):
        row: Record = {
            "motion": {"shake": "sway"}.get(motion, motion),
            "method": {"walking": "stadera", "ls": "plain least squares"}[method],
        }
        for key, metric in SHOWN.items():
            both = [found.get((motion, method, f"{metric}, {size}")) for size in ("median", "95th percentile")]
            row[key] = None if None in both else [float(f"{value:.2g}") for value in both if value is not None]
        rows.append(row)
    text = json.dumps(old | {"rows": rows}, ensure_ascii=False, indent=1)
    (RESULTS / "reality_table.json").write_text(text, encoding="utf-8")


def reality(record: Record) -> str:
    """Median and 95th percentile by motion; plain least squares below each."""
    columns = {
        "payload": "payload's mass [%]",
        "place": "its place, x-y [mm]",
        "trunk": "trunk's mass [%]",
        "centre": "its centre, x-y [mm]",
        "height": "z [mm]",
    }
    cells = {
        row["motion"] if row["method"] == "stadera" else f"{row['motion']}, {row['method']}": {
            label: "not observed" if row[key] is None else "; ".join(f"{value:g}" for value in row[key])
            for key, label in columns.items()
        }
        for row in record["rows"]
    }
    return table(cells, "median; 95th percentile")


def table(cells: dict[str, dict[str, str]], corner: str) -> str:
    """Rows by name, each with its cells by column."""
    columns = list(dict.fromkeys(name for found in cells.values() for name in found))
    lines = [f"| {corner} | {' | '.join(columns)} |", "|---" * (1 + len(columns)) + "|"]
    lines += [f"| {name} | {' | '.join(found.get(c, '') for c in columns)} |" for name, found in cells.items()]
    return "\n".join(lines)


def demo(runs: list[Record]) -> str:
    """Outcomes of the demo's two walks over the seeds, and what was weighed."""
    with_it, both = [run["with"] for run in runs], ("without", "with")
    payload = [run["payload"]["mass"] for run in with_it]
    off = [abs(weighed["value"] - run["load"]["mass"]) for run, weighed in zip(runs, payload, strict=True)]
    rows = {
        "outcome": [outcomes([run[way] for run in runs]) for way in both],
        "least margin of the true centre of mass [cm]": [
            span([100.0 * run[way]["least_margin"] for run in runs]) for way in both
        ],
        "steps lost": ["", span([run["steps_lost"] for run in with_it])],
        "got ahead, of what was commanded [m]": [
            span([run[way]["distance"] for run in runs]) + f" of {runs[0]['with']['commanded']:.2f}" * (way == "with")
            for way in both
        ],
        "noticed after [s]": ["", span([run["noticed_after"] for run in with_it])],
        "taken by controller and planner after [s]": ["", span([run["updated_after"] for run in with_it])],
        "box as weighed, truth 30 kg [kg]": ["", span([weighed["value"] for weighed in payload])],
        "its standard deviation [kg]": ["", span([weighed["std"] for weighed in payload])],
        "weighed within one standard deviation": [
            "",
            f"{sum(e <= weighed['std'] for e, weighed in zip(off, payload, strict=True))} of {len(runs)}",
        ],
    }
    head = f"| seeds {runs[0]['seed']} to {runs[-1]['seed']} | without identification | with it |\n|---|---|---|"
    return "\n".join([head, *(f"| {name} | {a} | {b} |" for name, (a, b) in rows.items())])


def replays() -> str:
    """Errors by model and run, of the runs that are kept, as `stadera replay --json` writes them."""
    cells: dict[str, dict[str, str]] = {}
    windows: tuple[str, ...] = ()
    for name in REPLAYS:
        rmse = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))["rmse"]
        windows = tuple(rmse)
        for model in rmse[windows[0]]:
            column = name.removeprefix("replay_").replace("_", ", ")
            cells.setdefault(model, {})[column] = "; ".join(short(rmse[w][model]["all"]) for w in windows)
    return f"Error [rad] after {'; '.join(windows)} s:\n\n{table(cells, '')}"


def outcomes(runs: Iterable[Record]) -> str:
    """How often each outcome was."""
    return ", ".join(
        f"{outcome} in {count}" for outcome, count in Counter(run["outcome"] for run in runs).most_common()
    )


def span(values: Iterable[float]) -> str:
    """Least and greatest; one value where they look the same."""
    least, greatest = short(min(known := list(values))), short(max(known))
    return least if least == greatest else f"{least} to {greatest}"


def read(name: str) -> list[Record] | None:
    """The records of a run; None where none is kept."""
    path = RESULTS / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


WHOLE: dict[str, tuple[str, Callable[[Any], str]]] = {
    "demo": ("demo", demo),
    "reality_table": ("reality_table", reality),
}
"""Tables that are made of all of a file, by the name between the marks."""


def renewed(page: str) -> str:
    """The page with its tables written anew; one whose run is not kept stays."""

    def table(found: re.Match[str]) -> str:
        name = found.group(1)
        if name == "overview":
            body = overview()
        elif name == "peers":
            body = peers()
        elif name == "replays":
            body = replays()
        elif name.startswith("ran_"):
            if (name := name.removeprefix("ran_")) not in noted():
                return found.group()
            body, name = ran(name), found.group(1)
        elif name in WHOLE:
            run, made = WHOLE[name]
            body = made(json.loads((RESULTS / f"{run}.json").read_text(encoding="utf-8")))
        elif (records := read(name)) is not None:
            body = "\n\n".join(tables(name, records))
        else:
            return found.group()
        return f"<!-- begin {name} -->\n{body}\n<!-- end {name} -->"

    return re.sub(r"<!-- begin (\w+) -->\n.*?<!-- end \1 -->", table, page, flags=re.DOTALL)


if __name__ == "__main__":
    if len(sys.argv) == 2:
        keep(Path(sys.argv[1]))
    note()
    for page in PAGES:
        page.write_text(renewed(page.read_text(encoding="utf-8")), encoding="utf-8")
