"""Lazy imports: names imported on first use, and packages that can be called like the function of the same name.

`import stadera` must not import what the caller does not use: MuJoCo, cvxpy and pyarrow take seconds together.
"""

import ast
import inspect
import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any


def lazy_names(package: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Returns `__all__`, `__getattr__` and `__dir__` (PEP 562) for a package that imports each public name on first
    use: those that it imports for type checkers, each as itself (`from module import name as name`).
    """
    source = ast.walk(ast.parse(inspect.getsource(sys.modules[package])))
    imports = (node for node in source if isinstance(node, ast.ImportFrom))
    homes = {each.name: str(node.module) for node in imports for each in node.names if each.asname}

    def getattr_(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        own = f"{package}.{name}"  # a package that can be called, see `make_callable`
        value = import_module(own) if homes[name].startswith(f"{own}.") else getattr(import_module(homes[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    names = sorted(homes)
    return names, getattr_, lambda: names


def make_callable(package: str, home: str) -> None:
    """Makes `package(...)` call the function of the same name in the module `home`, imported on the first call.

    `stadera.weigh(robot, log)` thus works whether or not the package `stadera.weigh` was imported before.
    """
    name = package.rpartition(".")[2]

    def function() -> Callable[..., Any]:
        found: Callable[..., Any] = getattr(import_module(home), name)
        return found

    class CallablePackage(ModuleType):
        def __call__(self, *args: Any, **kwargs: Any) -> Any:
            return function()(*args, **kwargs)

        @property
        def __signature__(self) -> inspect.Signature:
            return inspect.signature(function())

        @property
        def __doc__(self) -> str:  # type: ignore[override]
            return f"{name}{inspect.signature(function())}\n\n{inspect.getdoc(function())}"

    sys.modules[package].__class__ = CallablePackage
