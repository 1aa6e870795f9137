"""Compiled functions are stored; nothing breaks without a folder for that; what needs none does not wait for numba."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

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
import numpy as np
import kernel_of_a_test as made
print(made.total(np.arange(4.0)))
"""


def run(folder: Path, code: str) -> str:
    (folder / "kernel_of_a_test.py").write_text(_KERNEL)
    path = os.pathsep.join([str(folder), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_a_function_is_compiled_and_stored(tmp_path: Path) -> None:
    assert run(tmp_path, _USE) == "6.0"
    assert list((tmp_path / "__pycache__").glob("*.nbc"))


def test_without_a_folder_for_its_cache_a_function_is_compiled_all_the_same(tmp_path: Path) -> None:
    """As numba says it where neither the source's folder nor the user's can be written."""
    no_folder = """
import numba.core.caching as caching
caching.CacheImpl._locator_classes = []
caching.CompileResultCacheImpl._locator_classes = []
"""
    assert run(tmp_path, no_folder + _USE) == "6.0"
    assert not list(tmp_path.rglob("*.nbc"))


def test_the_package_does_not_import_numba_before_it_is_used() -> None:
    code = "import stadera, sys; stadera.load_robot; assert 'numba' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
