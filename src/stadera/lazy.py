"""Lazy imports: names imported on first use, and packages that can be called like the function of the same name.

`import stadera` must not import what the caller does not use: MuJoCo, cvxpy and pyarrow take seconds together.
"""

import inspect
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any


def lazy_names(
    package: str, modules: Mapping[str, str]
) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Returns `__all__`, `__getattr__` and `__dir__` (PEP 562) for a package that imports each public name on first
    use. `modules`: by module of the package, the names that it defines, or its own, with blanks between.
    """
    homes = {name: f"{package}.{module}" for module, names in modules.items() for name in names.split()}

    def getattr_(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = import_module(homes[name])
        value = module if homes[name] == f"{package}.{name}" else getattr(module, name)
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
