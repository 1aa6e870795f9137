"""Helpers that all tests share."""

from __future__ import annotations

import gc
import json
import os
from collections.abc import Callable, Generator, Iterator
from dataclasses import asdict, dataclass
from functools import wraps
from pathlib import Path

import pytest
from hypothesis import settings

from sharing import shared
from stadera.cli import main
from stadera.excite.trunk import design
from stadera.excite.trunk.planted import PayloadBars
from stadera.robot.model import Robot

ROOT = Path(__file__).resolve().parent.parent

settings.register_profile("fixed", derandomize=True)
settings.load_profile("fixed")


LONG = (
    "test_site.py",
    "lab/experiments/test_humanoids.py",
    "identify/test_legs.py",
    "trunk/test_any_robot.py",
    "test_paths.py",
    "checks/test_torque_order.py",
    "contracts/test_estimator_contract.py",
    "trunk/test_estimator.py",
    "lab/demo/test_demo.py",
    "test_docs.py",
    "weigh/test_weighing.py",
    "trunk/test_robot_memory.py",
    "lab/control/test_crawl.py",
    "weigh/test_other_robot.py",
    "weigh/test_extra_joints.py",
    "weigh/test_without_imu.py",
    "lab/supervise/test_supervisor.py",
    "lab/experiments/test_standing.py",
    "lab/experiments/test_experiments.py",
    "trunk/test_change_bars.py",
    "test_notebooks.py",
    "live/test_zenoh.py",
    "live/test_session.py",
    "weigh/test_next_steps.py",
    "cli/test_weigh.py",
)
"""Files that take longest, from `pytest --durations`: they begin first, so that no process waits for one at the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    tests = ROOT / "tests"
    rank = {str(tests / name): k for k, name in enumerate(LONG)}
    items.sort(key=lambda item: rank.get(str(item.path), len(LONG)))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Nothing of what is collected is garbage, and looking for it took a quarter of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real logs: STADERA_DATA, else ../shared/data beside the project; skips where neither exists."""
    named = os.environ.get("STADERA_DATA")
    folder = Path(named) if named else ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real logs: {folder} does not exist (set STADERA_DATA to their folder)")
    return folder


@pytest.fixture(autouse=True, scope="session")
def bars_of_named_robots(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What a sway and ten steps bring is computed once a robot, for a tenth of its weight, not once for every load and
    process; `weigh/test_next_steps.py` asks for it as it is.
    """
    with pytest.MonkeyPatch.context() as patch:
        for name in ("undesigned_bars", "bars_of_steps"):
            patch.setattr(design, name, once(getattr(design, name), tmp_path_factory))
        yield


Bars = Callable[[Robot, float], PayloadBars | None]


def once(bars: Bars, factory: pytest.TempPathFactory) -> Bars:
    known: dict[tuple[str, float], PayloadBars | None] = {}

    def write(to: Path, robot: Robot) -> None:
        made = bars(robot, 0.1)
        (to / "bars.json").write_text(json.dumps(None if made is None else asdict(made)))

    @wraps(bars)
    def found(robot: Robot, _: float) -> PayloadBars | None:
        key = robot.name, robot.mass
        if key not in known:
            name = f"{bars.__name__}-{robot.name}-{robot.mass!r}"
            kept = json.loads((shared(factory, name, lambda to: write(to, robot)) / "bars.json").read_text())
            known[key] = None if kept is None else PayloadBars(**kept | {"com": tuple(kept["com"])})
        return known[key]

    return found


@dataclass(frozen=True)
class Finished:
    """A command that was run in this process: its exit code, and what it printed."""

    code: int
    out: str
    err: str


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Finished]:
    def _run(*arguments: object) -> Finished:
        with pytest.raises(SystemExit) as exit_info:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Finished(int(exit_info.value.code or 0), captured.out, captured.err)

    return _run
