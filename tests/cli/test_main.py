"""Exit codes, and what goes where."""

from __future__ import annotations

import errno
import io
import subprocess
import sys

import pytest

import stadera
from stadera.cli import app, main
from stadera.cli.terminal import show
from stadera.errors import StaderaError


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


@pytest.mark.parametrize("command", ["identify", "weigh", "inspect", "excite", "simulate", "demo", "reproduce"])
def test_help_loads_nothing_heavy(command):
    heavy = ("cvxpy", "matplotlib", "jinja2", "pinocchio", "mujoco", "scipy", "pyarrow", "rich", "numpy")
    code = (
        "import sys\n"
        "from stadera.cli import main\n"
        f"try:\n    main([{command!r}, '--help'])\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {heavy!r} if name in sys.modules], file=sys.stderr)"
    )
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert finished.stderr.strip() == "[]"


@pytest.fixture
def faulty(monkeypatch):
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("a\nfault")

    monkeypatch.setattr(app, "app", broken)


@pytest.mark.usefixtures("faulty")
def test_a_fault_of_the_program_is_one_line_that_says_how_to_report_it(run):
    finished = run("inspect", "hyq")
    assert (finished.code, finished.out) == (1, "")
    assert finished.err.startswith("stadera: error: internal error, RuntimeError: a fault; please report it")
    assert "--debug" in finished.err
    assert finished.err.count("\n") == 1


@pytest.mark.usefixtures("faulty")
@pytest.mark.parametrize(("arguments", "variable"), [(["inspect", "hyq", "--debug"], "0"), (["inspect", "hyq"], "1")])
def test_debug_shows_where_a_fault_is(monkeypatch, arguments, variable):
    monkeypatch.setenv("STADERA_DEBUG", variable)
    with pytest.raises(RuntimeError, match="a\nfault"):
        main(arguments)


def test_debug_is_an_option_of_every_command_and_changes_no_answer(run):
    plain, debugged = run("inspect", "hyq"), run("inspect", "hyq", "--debug")
    assert (debugged.code, debugged.out, debugged.err) == (plain.code, plain.out, "")
    with pytest.raises(StaderaError, match="neither a file nor a robot's name"):
        main(["--debug", "inspect", "nosuch"])


def test_what_a_terminal_shows_needs_neither_plots_nor_pages():
    code = (
        "import sys\n"
        "import stadera.report.excite.leg, stadera.report.identify.tables\n"
        "import stadera.report.inspect, stadera.report.weigh.tables\n"
        "print([name for name in ('matplotlib', 'jinja2') if name in sys.modules])"
    )
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert finished.stdout.strip() == "[]"


def shell(command: str) -> subprocess.CompletedProcess[str]:
    """The command line in a shell, `stadera` being this one."""
    run = f"{sys.executable} -m stadera"
    script = f"set -o pipefail; {command.replace('stadera', run)}"
    return subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("command", ["stadera inspect hyq >&-", "stadera inspect hyq | true"])
def test_a_reader_who_is_not_there_is_no_error(command):
    finished = shell(command)
    assert (finished.returncode, finished.stderr) == (0, "")


def test_a_stdout_that_cannot_be_written_to_is_named(monkeypatch):
    class Full(io.StringIO):
        def flush(self):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sys, "stdout", Full())
    with pytest.raises(StaderaError, match=r"^standard output: No space left on device$"):
        show("text")


def test_names_are_shown_as_they_are_and_no_terminal_takes_them_for_commands(run, tmp_path):
    path = tmp_path / "[b]:smile:.csv"
    path.write_text("time,a.position\n0,1\n1,2\n")
    assert "/[b]:smile:.csv" in run("inspect", path).out
    path.write_text("neither\n")
    for name, shown in (("no\x1b[2J.csv", "no\\x1b[2J.csv"), ("\udcff.csv", "\\udcff.csv")):
        path.rename(tmp_path / name)
        finished = run("inspect", tmp_path / name, "--robot", "hyq")
        assert finished.code == 1
        assert shown in finished.err
        (tmp_path / name).rename(path)


@pytest.mark.parametrize(
    "command",
    [
        "weigh go2_legs_in_air --robot go2",
        "identify go2_legs_in_air --robot go2",
        "compare go2_legs_in_air --robot go2",
        "fleet go2_legs_in_air --robot go2 --out table.parquet",
        "replay go2_legs_in_air --robot go2 --against go2",
        "simulate stand --robot hyq --out log.csv",
        "excite --robot hyq --trunk",
        "live --robot hyq",
    ],
    ids=lambda command: command.split()[0],
)
def test_feet_can_be_named_wherever_a_robot_can(command, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ended = run(*command.split(), "--feet", "nonsense")
    assert ended.code == 1
    assert "unknown foot 'nonsense'" in ended.err
    assert not list(tmp_path.glob("log*"))
