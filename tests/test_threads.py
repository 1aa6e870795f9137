"""Small linear algebra uses one thread, and the limit of before holds again afterwards."""

from importlib import import_module

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import stadera
from stadera.process import one_thread


def threads() -> list[int]:
    """Of each BLAS in this process."""
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_blas_has_one_thread_within_and_as_many_as_before_afterwards() -> None:
    with one_thread():
        inside = threads()
    outside = threads()
    with one_thread(), one_thread():
        pass
    assert inside
    assert set(inside) == {1}
    assert threads() == outside


def test_weighing_uses_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[int] = []

    def looked(*_: object) -> None:
        found.extend(threads())
        raise RuntimeError("seen")

    monkeypatch.setattr(import_module("stadera.weigh.weigh"), "check_choice", looked)
    with pytest.raises(RuntimeError, match="seen"):
        stadera.weigh("hyq", np.zeros(1))  # type: ignore[arg-type]
    assert set(found) == {1}
