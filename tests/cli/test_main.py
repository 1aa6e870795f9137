"""Exit codes, and what goes where."""

from __future__ import annotations

import subprocess
import sys

import pytest

import stadera
from stadera.cli import app, main


def test_version(run):
    finished = run("--version")
    assert (finished.code, finished.out) == (0, f"stadera {stadera.__version__}\n")


def test_help_names_every_command(run):
    finished = run("--help")
    assert finished.code == 0
    assert "identify" in finished.out
    assert "inspect" in finished.out


@pytest.mark.parametrize(
    "arguments", [["identify"], ["nonsense"], ["identify", "a.csv", "--robot", "hyq", "--nonsense"]]
)
def test_bad_usage_is_exit_2(run, arguments):
    finished = run(*arguments)
    assert finished.code == 2
    assert not finished.out


def test_help_loads_nothing_heavy():
    heavy = ("cvxpy", "plotly", "pinocchio", "mujoco", "scipy", "pyarrow", "rich", "numpy")
    code = (
        "import sys\n"
        "from stadera.cli import main\n"
        "try:\n    main(['identify', '--help'])\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {heavy!r} if name in sys.modules], file=sys.stderr)"
    )
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert finished.stderr.strip() == "[]"


def test_a_fault_of_the_program_is_not_hidden(monkeypatch):
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("a fault")

    monkeypatch.setattr(app, "app", broken)
    with pytest.raises(RuntimeError, match="a fault"):
        main(["inspect", "hyq"])
