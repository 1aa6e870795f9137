"""Tables of `peers.py`: where a peer is ahead of stadera, why stands in its row."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import comb
from typing import Any

Row = dict[str, Any]

OURS, TRUTH = "stadera", "the true parameters"
LEG_FIGURES, TRUNK_FIGURES = ("seconds", "mb", "rmse", "error"), ("mass", "place", "latency", "coverage")
CHANCE = 0.05
"""Level of the sign test, two-sided, above which a peer's lead in single runs counts as chance."""

REASONS: dict[str, str] = {
    "seconds": "time: one least squares, without a search for cut-off and torque lag, physical consistency, checks",
    "mb": "memory: less by what stadera's search, checks and solver hold, which does not grow with the log's length "
    "(`benchmarks/offline_leg.py` streams an hour)",
    "rmse": "held out: fits friction's steps as the low-pass smears them, so lies below the true parameters' residual; "
    "see the error to truth",
    "place": "place: assumes no joint friction, which is true of `standard`; on a robot friction can hold a load, "
    "so stadera's default states no place at rest (`weigh --method contact` assumes the same as this)",
}
"""Of a lead, by figure, unless it is within the scatter of the runs."""


def explained(rows: list[Row], figures: Sequence[str]) -> list[Row]:
    """The rows with `ahead`: for each figure in which the row is ahead of stadera's, the reason."""
    own = {row["case"]: row for row in rows if row["contender"] == OURS}
    return [row | {"ahead": dict(_ahead(row, own[row["case"]], figures))} for row in rows if row["case"] in own]


def _ahead(row: Row, ours: Row, figures: Sequence[str]) -> Iterable[tuple[str, str]]:
    if "skipped" in row or "skipped" in ours or row["contender"] in (OURS, TRUTH):
        return
    for figure in figures:
        mine, theirs = _cost(ours, figure), _cost(row, figure)
        if theirs is not None and (mine is None or _rounded(theirs) < _rounded(mine)):
            yield figure, _by_chance(row, ours, figure) or REASONS.get(figure, f"{figure}: no explanation")


def _cost(row: Row, figure: str) -> float | None:
    """Less is better; a coverage is worth what it lacks to 95 %."""
    value = row.get(figure)
    if figure == "coverage":
        return None if value is None else max(0.0, 0.95 - value)
    return value if value is None else float(value)


def _rounded(value: float) -> float:
    """To the two digits that are worth something."""
    return float(f"{value:.2g}")


def _by_chance(row: Row, ours: Row, figure: str) -> str:
    """What a sign test over the single runs says; empty where the lead is real or there are no single runs."""
    pairs = [
        (_cost(a, figure), _cost(b, figure)) for a, b in zip(row.get("runs", ()), ours.get("runs", ()), strict=True)
    ]
    told = [(a, b) for a, b in pairs if a is not None and b is not None and a != b]
    wins = sum(a < b for a, b in told)
    if not told or sign_test(wins, len(told)) < CHANCE:
        return ""
    return f"{figure}: by chance, nearer in {wins} of {len(told)} runs"


def sign_test(wins: int, runs: int) -> float:
    """Probability of a split as uneven as this or more so, if both were as good."""
    tail = sum(comb(runs, k) for k in range(max(wins, runs - wins), runs + 1)) / 2.0**runs
    return min(1.0, 2.0 * tail)


def markdown(record: dict[str, Any]) -> str:
    """The tables of a run's JSON."""
    parts = []
    for case in dict.fromkeys(row["case"] for row in record["legs"]):
        parts.append(f"Leg, {record['cases'][case]}:\n\n{_table(LEG_COLUMNS, _of(record['legs'], case))}")
    if record["trunks"]:
        parts.append(f"Trunk, medians: {TRUNK_CELL}:\n\n{_trunks(record['trunks'])}")
    given = {said for row in [*record["legs"], *record["trunks"]] for said in row.get("ahead", {}).values()}
    known = [f"- {said}" for said in REASONS.values() if said in given]
    return "\n\n".join([*parts, *(["Ahead of stadera in, and why:\n\n" + "\n".join(known)] if known else [])])


def _of(rows: list[Row], case: str) -> list[Row]:
    return [row for row in rows if row["case"] == case]


def _trunks(rows: list[Row]) -> str:
    """A row a contender, a column a case."""
    cases, cells = list(dict.fromkeys(row["case"] for row in rows)), {}
    for row in rows:
        told, remark = "; ".join(shown(row) for shown in TRUNK_FIGURE.values()), _remark(row)
        told = f"{told} ({remark})" if remark else told
        cells.setdefault(row["contender"], []).append("no estimate" if row.get("mass") is None else told)
    lines = [f"| {name} | {' | '.join(own)} |" for name, own in cells.items()]
    head = [f"{case}, {len(_of(rows, case)[0]['runs'])} runs" for case in cases]
    return "\n".join([f"| | {' | '.join(head)} |", "|---" * (len(cases) + 1) + "|", *lines])


def _table(columns: dict[str, Callable[[Row], str]], rows: list[Row]) -> str:
    cells = [list(columns), *([cell(row) for cell in columns.values()] for row in rows)]
    lines = [f"| {' | '.join(line)} |" for line in cells]
    return "\n".join([lines[0], "|---" * len(columns) + "|", *lines[1:]])


def _number(key: str, digits: int) -> Callable[[Row], str]:
    return lambda row: "–" if row.get(key) is None else f"{row[key]:.{digits}f}"


def _said(key: str) -> Callable[[Row], str]:
    words = {True: "yes", False: "no", None: "not given"}
    return lambda row: "–" if "skipped" in row or row["contender"] == TRUTH else words[row[key]]


def _remark(row: Row) -> str:
    if "skipped" in row:
        return f"skipped: {row['skipped']}"
    return "; ".join(said.split(":")[0] if said in REASONS.values() else said for said in row["ahead"].values())


def _coverage(row: Row) -> str:
    return "no bars" if row["coverage"] is None else f"{100 * row['coverage']:.0f}"


LEG_COLUMNS: dict[str, Callable[[Row], str]] = {
    "": lambda row: row["contender"],
    "processor time [s]": _number("seconds", 2),
    "memory [MB]": _number("mb", 0),
    "held-out RMSE [N·m]": _number("rmse", 3),
    "error to truth [N·m]": _number("error", 3),
    "physical": _said("physical"),
    "error bars": _said("bars"),
    "ahead in": _remark,
}
TRUNK_FIGURE: dict[str, Callable[[Row], str]] = {
    "mass [% of the robot]": _number("mass", 2),
    "place [mm]": _number("place", 1),
    "latency [s]": _number("latency", 1),
    "within 2 σ [%]": _coverage,
}
TRUNK_CELL = f"{'; '.join(TRUNK_FIGURE)} (and in what it is ahead of stadera)"
