"""The real logs that come with the package: the source's values, readable by name from any folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stadera.errors import RecordingError
from stadera.logs import LogFile, read
from stadera.logs.topics import EXAMPLES, example


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_have_licence_source_and_all_joints(name: str) -> None:
    log = read(name)
    assert log.effort is not None
    assert log.velocity is not None
    assert log.joints == read(LogFile.of(name), joints=log.joints).joints
    assert LogFile(name) == LogFile.of(name)  # type: ignore[arg-type]
    assert example(name).stat().st_size < 600_000
    words = (example(name).parent / "README.md").read_text()
    licence = next(line for line in words.splitlines() if f"`{name}`" in line and line.startswith("|"))
    assert "github.com" in licence or "the same" in licence


@pytest.mark.parametrize("name", ["go2_legs_in_air", "aliengo_legs_in_air"])
def test_values_are_the_sources(shared_data: Path, name: str) -> None:
    log, source = read(name), read(shared_data / "real" / f"{name}.csv")
    np.testing.assert_array_equal(log.time, source.time)
    for channel in ("position", "velocity", "effort"):
        np.testing.assert_allclose(getattr(log, channel), getattr(source, channel), rtol=6e-8, atol=1e-9)


def test_a_file_of_that_name_goes_before_and_others_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RecordingError, match="nosuch: no such file; logs that come with stadera: go2_legs_in_air, "):
        read("nosuch")
    (tmp_path / "go2_trot").write_text("time,a.position\n0,1\n1,2\n")
    assert read("go2_trot").joints == ("a",)
