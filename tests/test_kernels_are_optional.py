"""Compiled kernels are optional: nothing imports numba by itself; nothing breaks without it or its cache."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("numba")

_KERNEL = """
from stadera.compiled import compiled

@compiled("float64(float64[::1])")
def total(values):
    out = 0.0
    for value in values:
        out += value
    return out
"""
_USE = """
import numpy as np, sys
import stadera.compiled as compiled
assert "numba" not in sys.modules
made = compiled.kernel("kernel_of_a_test")
print(None if made is None else (made.total(np.arange(4.0)), hasattr(made.total, "py_func")))
"""


def run(folder: Path, code: str = _USE, **environment: str) -> str:
    (folder / "kernel_of_a_test.py").write_text(_KERNEL)
    path = os.pathsep.join([str(folder), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path, **environment},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_a_kernel_is_compiled_and_stored(tmp_path: Path) -> None:
    assert run(tmp_path) == "(6.0, True)"
    assert list((tmp_path / "__pycache__").glob("*.nbc"))


def test_without_numba_there_is_no_kernel_and_its_module_imports(tmp_path: Path) -> None:
    absent = "import sys; sys.modules['numba'] = None\n"
    assert run(tmp_path, absent + _USE.replace('assert "numba" not in sys.modules', "")) == "None"
    assert run(tmp_path, absent + "from kernel_of_a_test import total; print(total([1.0, 2.0]))") == "3.0"


def test_where_compilation_is_switched_off_there_is_no_kernel(tmp_path: Path) -> None:
    assert run(tmp_path, NUMBA_DISABLE_JIT="1") == "None"


def test_without_a_folder_for_its_cache_a_kernel_is_compiled_all_the_same(tmp_path: Path) -> None:
    """As numba says it where neither the source's folder nor the user's can be written."""
    no_folder = """
import numba.core.caching as caching
caching.CacheImpl._locator_classes = []
caching.CompileResultCacheImpl._locator_classes = []
"""
    assert run(tmp_path, no_folder + _USE.replace('assert "numba" not in sys.modules', "")) == "(6.0, True)"
    assert not list(tmp_path.rglob("*.nbc"))


def test_the_package_does_not_import_numba() -> None:
    code = "import stadera, sys; stadera.TrunkEstimator; assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
