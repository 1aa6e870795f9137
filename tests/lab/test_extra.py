"""The laboratory is an extra: what names it, and what does without."""

from __future__ import annotations

import subprocess
import sys

import pytest

from stadera import lab
from stadera.cli import main


@pytest.mark.parametrize("command", [("simulate", "stand", "--out", "a.csv"), ("reproduce", "table1"), ("demo",)])
def test_a_command_without_its_packages_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: tuple[str, ...]
) -> None:
    monkeypatch.setattr(lab, "find_spec", lambda package: None)
    with pytest.raises(SystemExit) as finished:
        main(command)
    assert finished.value.code == 1
    assert (
        f"stadera {command[0]} needs the packages 'mujoco' and 'proxsuite', of the extra stadera[lab]: "
        "pip install mujoco proxsuite" in capsys.readouterr().err
    )


def test_the_truth_of_a_run_is_read_without_the_test_bed() -> None:
    code = (
        "import sys, stadera.lab.truth\n"
        "print([name for name in ('mujoco', 'proxsuite', 'cvxpy') if name in sys.modules])"
    )
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert finished.stdout.strip() == "[]"
