"""What README and docs name is there: files of the source, dotted names, links, commands; and their code runs."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest
import typer.main

from bags import of_recording, write_mcap
from logs_to_play import swing_log, walk_log
from stadera.cli import main
from stadera.cli.app import app
from stadera.logs import read, take
from stadera.robot.catalog import find_file

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
CURRENT = [page for page in PAGES if page.name != "CHANGELOG.md"]  # which tells of what was
BASES = (ROOT, ROOT / "src", ROOT / "src" / "stadera", ROOT / "docs")


GENERATED = {"contributing.md", "changelog.md", "cli.md"}  # by docs/hooks.py


def ids(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", CURRENT, ids=ids)
def test_files_of_the_source_are_there(page: Path) -> None:
    named = re.findall(r"`((?:[\w.]+/)+(?:\w+\.\w+)?)`", page.read_text())
    missing = [
        name for name in named if not any((base / name).exists() for base in BASES) and not name.startswith("out/")
    ]
    assert not missing


@pytest.mark.parametrize("page", CURRENT, ids=ids)
def test_dotted_names_are_there(page: Path) -> None:
    missing = [name for name in re.findall(r"`(stadera(?:\.\w+)+)", page.read_text()) if not resolves(name)]
    assert not missing


def resolves(name: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    parts = name.split(".")
    for depth in range(len(parts), 0, -1):
        try:
            found: object = import_module(".".join(parts[:depth]))
        except ModuleNotFoundError:
            continue
        for part in parts[depth:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_links_lead_somewhere(page: Path) -> None:
    targets = re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text())
    missing = [t for t in targets if not (page.parent / t).exists() and Path(t).name not in GENERATED]
    assert not missing


# -- commands ---------------------------------------------------------------------------------------------------------
def commands(page: Path) -> list[list[str]]:
    lines = re.findall(r"^    (stadera [^#\n]+)", page.read_text(), re.MULTILINE)
    return [shlex.split(line.replace("LOG", "log.csv")) for line in lines]


@cache
def options_of(command: str) -> frozenset[str]:
    """Of a command of the program, as its help lists them."""
    found = typer.main.get_group(app).commands[command]
    return frozenset(name for option in found.params for name in (*option.opts, *option.secondary_opts))


@pytest.mark.parametrize("page", [page for page in CURRENT if commands(page)], ids=ids)
def test_commands_have_their_options(page: Path) -> None:
    for _, command, *arguments in commands(page):
        options = [word for word in arguments if word.startswith("--")]
        missing = [option for option in options if option.split("=")[0] not in options_of(command)]
        assert not missing, command


def test_what_is_to_be_expected_is_printed_by_a_command_of_the_page() -> None:
    """Written by `python docs/outputs.py`; names of files do not count."""
    sys.path.insert(0, str(ROOT / "docs"))

    def plain(words: list[str]) -> set[str]:
        return {word for word in words if not re.search(r"\.(csv|parquet|mcap|json|html|yaml|py:\w+)$", word)}

    for name, (command, _) in import_module("outputs").OUTPUTS.items():
        (page,) = [page for page in CURRENT if f"<!-- begin out_{name} -->" in page.read_text()]
        told = [plain(words[1:]) for words in commands(page)]
        assert any(plain(shlex.split(command)) <= words for words in told), name


# -- code that runs ---------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot and its logs, by the names that the pages give them."""
    made = tmp_path_factory.mktemp("reader")
    (made / "robot.urdf").write_bytes(find_file("hyq").read_bytes())
    swing_log(made / "swing.csv")
    walk_log(made / "walk.csv")
    return made


ELSEWHERE = {
    "demo": "tests/lab/demo",
    "reproduce": "tests/lab/experiments, tests/cli/test_reproduce.py",
    "live": "tests/live",
    "fleet": "tests/cli/test_fleet.py",
    "excite": "tests/cli/test_excite.py",
    "identify": "the README's commands",
    "replay": "tests/lab/test_replay.py",
    "g1": "tests/trunk/test_any_robot.py",
    "--legs": "tests/cli/test_weigh_walking.py",
    "trot.csv": "docs/start.md",
    "poses.csv": "tests/weigh/test_without_imu.py",
    "log.parquet": "tests/cli/test_simulate.py",
    "--columns": "tests/logs/test_foreign.py: logs of other tools",
    "walk.parquet": "tests/test_paths.py, on a bag",
    "stand.csv": "tests/weigh/test_own_method.py",
    "--pd": "tests/logs/test_foreign.py: desired positions",
}
"""Commands that other tests run, by a word of theirs."""

OWN = {ROOT / "README.md", ROOT / "docs" / "start.md"}  # tests/test_paths.py
AT_HAND = {"go2": "hyq", "0:10": "0:1.2", "0:4": "0:1.2"}
"""What commands name that is not here, and what is."""


def remaining(page: Path) -> Iterator[list[str]]:
    """Commands of a page that nothing else runs, on the robot and the logs at hand; simulations are shorter."""
    for words in () if page in OWN else commands(page):
        if any(word in ELSEWHERE for word in words):
            continue
        words = [AT_HAND.get(word, word) for word in words[1:]]
        yield [*words, "--duration", "3.0"] if words[0] == "simulate" else words


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of HyQ by the names that the pages give them: `start.md` makes the real ones."""
    made = tmp_path_factory.mktemp("pages")
    walk = read(walk_log(made / "walk.csv"))
    (made / "log.csv").write_bytes((made / "walk.csv").read_bytes())
    write_mcap(of_recording(walk), made / "walk.mcap")
    for name, rows in (("empty.mcap", slice(0, 500)), ("loaded.mcap", slice(700, None))):
        write_mcap(of_recording(take(walk, rows)), made / name)
    return made


@pytest.mark.parametrize("page", [page for page in CURRENT if any(remaining(page))], ids=ids)
def test_commands_of_the_other_pages_run(page: Path, logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(logs)
    for words in remaining(page):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert not ended.value.code, words


def blocks(page: Path) -> str:
    """The Python of a page, its blocks one after the other."""
    return "\n".join(re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize("page", [page for page in CURRENT if blocks(page)], ids=ids)
def test_python_runs(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    exec(compile(blocks(page), str(page), "exec"), {"__name__": "__main__"})


# -- the published experiments ----------------------------------------------------------------------------------------
def experiment_tables() -> ModuleType:
    spec = spec_from_file_location("experiment_tables", ROOT / "docs" / "experiment_tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_tables_of_the_experiments_are_those_of_the_runs() -> None:
    made = experiment_tables()
    pages = [path.read_text() for path in made.PAGES]
    assert list(map(made.renewed, pages)) == pages, "python docs/experiment_tables.py writes them"
    assert {name: run["sha256"] for name, run in made.noted().items()} == made.hashes(), "and notes date and commit"
    for block in re.findall(r"(?:^\|.*\n)+", "\n".join(pages), re.MULTILINE):
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in block.splitlines()}) == 1, block
    page = (ROOT / "docs" / "validation" / "paper.md").read_text()
    commands_listed = [line.split("`")[1] for line in page.splitlines() if line.startswith("| `stadera reproduce")]
    assert len(commands_listed) == len(set(commands_listed)), "a row a command"
    shown = "\n".join(pages)
    assert not [name for name in made.noted() if name not in made.REPLAYS[1:] and f"begin ran_{name} -->" not in shown]
    kept = {path.stem for path in made.RESULTS.glob("*.json")}
    assert (
        {"table1", "fig4", "fig5", "fig6", "demo"}
        <= kept
        <= {*made.PAPER, *made.STUDIES, *made.REPLAYS, "demo", "peers", "runs"}
    )
    assert sum(path.stat().st_size for path in made.RESULTS.iterdir()) < 300_000


def test_figures_of_the_experiments_are_those_of_the_runs() -> None:
    pytest.importorskip("matplotlib", reason="needs pip install 'stadera[figures]'")
    sys.path.insert(0, str(ROOT / "docs"))
    made = import_module("result_figures")
    drawn = {name: (ROOT / "docs" / "figures" / f"{name}.svg").read_text() for name in made.FIGURES}
    assert [name for name in drawn if made.source(name) not in drawn[name]] == [], "python docs/result_figures.py"


def test_every_figure_is_shown_and_made() -> None:
    shown = "\n".join(page.read_text() for page in CURRENT)
    figures = sorted((ROOT / "docs" / "figures").iterdir())
    assert not [path.name for path in figures if f"figures/{path.name}" not in shown]
    makers = "\n".join(path.read_text() for path in (ROOT / "docs").glob("*.py"))
    assert not [path.name for path in figures if path.stem not in makers]


def test_a_missed_bound_is_marked() -> None:
    record = {"case": {}, "unit": "s", "metric": "time", "value": 2.152, "paper": 2.0, "bound": 2.0, "met": False}
    assert experiment_tables().cell(record) == "2.15 (2) ✗"
