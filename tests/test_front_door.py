"""The names of `import stadera`: all there, light to import, and callable whatever was imported before."""

from __future__ import annotations

import ast
import inspect
import pydoc
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stadera
from stadera.logs.frames import columns_of
from stadera.trunk import Samples
from standing import static_log

HEAVY = ("mujoco", "matplotlib", "pyarrow", "cvxpy", "rosbags", "proxsuite", "jinja2")


def fresh(code: str) -> str:
    """What a new interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_loading_a_urdf_and_the_online_estimator_imports_nothing_heavy() -> None:
    code = (
        "import sys, time, stadera; stadera.TrunkEstimator; stadera.load_robot('hyq');"
        f"print([name for name in {HEAVY} if name in sys.modules]); print(time.process_time())"
    )
    loaded, seconds = fresh(code).splitlines()
    assert loaded == "[]"
    assert float(seconds) < 2.0  # about 0.5 on a quiet machine; several times that would be a heavy import


def test_weighing_imports_no_signal_processing() -> None:
    """`scipy.signal` alone takes longer to import than most logs to weigh; a log with all channels needs none of it."""
    parts = ("signal", "stats", "interpolate", "optimize", "spatial", "ndimage")
    code = (
        "import sys, stadera.cli.app; import stadera.weigh.weigh;"
        f"print([name for name in {parts} if 'scipy.' + name in sys.modules])"
    )
    assert fresh(code) == "[]"


def test_import_alone_does_not_even_import_numpy() -> None:
    assert fresh("import sys, stadera; print('numpy' in sys.modules)") == "False"


def test_typed_names_are_the_lazy_ones() -> None:
    tree = ast.parse(Path(inspect.getfile(stadera)).read_text())
    block = next(n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING")
    typed = {alias.asname or alias.name for n in block.body if isinstance(n, ast.ImportFrom) for alias in n.names}
    assert typed == set(stadera.__all__)


@pytest.mark.parametrize("name", stadera.__all__)
def test_every_name_is_there(name: str) -> None:
    value = getattr(stadera, name)
    assert callable(value)
    assert value.__doc__
    assert name in dir(stadera)


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        stadera.nonsense  # noqa: B018


@pytest.mark.parametrize("before", [True, False])
def test_packages_are_called_like_functions(before: bool) -> None:
    rooms, names = "stadera.identify.legs, stadera.weigh.settings, stadera.excite.design", "identify, weigh, excite"
    statements = [f"import {rooms}", f"from stadera import {names}"]
    code = "; ".join(statements if before else reversed(statements))
    out = fresh(f"import inspect, stadera; {code}\n"
                f"for one, other in zip(({names}), (stadera.identify, stadera.weigh, stadera.excite), strict=True):\n"
                "    print(callable(one), one is other, *inspect.signature(one).parameters)")  # fmt: skip
    assert [line.split()[:3] for line in out.splitlines()] == [["True", "True", "robot"]] * 3


def test_calling_a_package_calls_its_function() -> None:
    with pytest.raises(stadera.RecordingError, match="no log given"):
        stadera.identify(stadera.load_robot("hyq"), [])


def test_load_robot_returns_a_robot_as_it_is() -> None:
    robot = stadera.load_robot("hyq")
    assert stadera.load_robot(robot) is robot


def test_a_urdf_loads_without_mujoco_and_an_mjcf_names_the_extra(tmp_path: Path) -> None:
    model = tmp_path / "robot.xml"
    model.write_text("<mujoco/>")
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "import stadera\n"
        "stadera.load_robot('hyq')\n"
        f"try: stadera.load_robot({str(model)!r})\n"
        "except stadera.MissingExtraError as error: print(error)"
    )
    assert "stadera[lab]" in fresh(code)


def test_reprs_are_short() -> None:
    robot = stadera.load_robot("hyq")
    assert "LF: lf_haa_joint" in repr(robot)
    assert "mass 60.978 kg" in repr(robot.inertias[robot.trunk])
    for value in (robot, robot.inertias[robot.trunk]):
        assert len(repr(value).splitlines()) < 10
        assert len(repr(value)) < 1000


def standing() -> stadera.Recording:
    return static_log(stadera.load_robot("hyq"))


def test_what_is_asked_about_answers_in_few_lines() -> None:
    """Trunk, payload, log, estimator: under ten lines each, and no digits of what was not observed."""
    robot, log = stadera.load_robot("hyq"), standing()
    estimator = stadera.TrunkEstimator(robot)
    assert "mass not observed; com not observed" in repr(estimator)
    estimator.add(Samples.of_recording(log, robot))
    estimator.tare()
    result = stadera.weigh(robot, log, tare=(0.0, 1.0))
    for value in (estimator, estimator.trunk, estimator.payload, log, log.imu, result):
        assert len(repr(value).splitlines()) < 10
        assert len(repr(value)) < 1000
        assert "nan" not in repr(value)
    assert " ± " in repr(estimator.trunk)
    assert repr(log).startswith("Recording of ")


def test_names_only() -> None:
    assert dir(stadera) == sorted(stadera.__all__)


@pytest.mark.parametrize("name", ["identify", "weigh", "excite"])
def test_help_shows_arguments(name: str) -> None:
    text = pydoc.plain(pydoc.render_doc(getattr(stadera, name)))
    assert f"{name}(robot" in text
    assert "Args:" in text


def test_what_is_wanted_is_said() -> None:
    log, six = standing(), np.zeros((4, 6))
    time, q = np.arange(4.0), np.zeros((4, 1))
    half = stadera.Imu(None, np.zeros((4, 3)))  # type: ignore[arg-type]
    with pytest.raises(stadera.RecordingError, match=r"imu needs stadera\.Imu\(angular_velocity.*ndarray"):
        stadera.Recording.from_arrays(time, q, joints=["a"], imu=six)  # type: ignore[arg-type]
    with pytest.raises(stadera.RecordingError, match=r"needs shape \(4, 3\), got \(3, 4\): transposed"):
        stadera.Recording.from_arrays(time, q, joints=["a"], imu=stadera.Imu(np.zeros((3, 4)), np.zeros((3, 4))))
    with pytest.raises(stadera.RecordingError, match=r"imu needs stadera\.Imu\(angular_velocity.*got one that is None"):
        stadera.Recording.from_arrays(time, q, joints=["a"], imu=half)
    with pytest.raises(stadera.ModelError, match="a robot is a name, a path or a Robot, got int"):
        stadera.load_robot(3)  # type: ignore[arg-type]
    with pytest.raises(stadera.RecordingError, match=r"add takes .*Samples, got ndarray; one sample: update"):
        stadera.TrunkEstimator("hyq").add(six)  # type: ignore[arg-type]
    with pytest.raises(stadera.RecordingError, match="a Recording or a data frame, got int"):
        stadera.weigh("hyq", 3)  # type: ignore[arg-type]
    assert stadera.weigh("hyq", log, tare=[0.0, 1.0]).payload is not None  # type: ignore[arg-type]


def test_a_data_frame_is_a_log() -> None:
    log = standing()
    frame = columns_of(log)
    found = stadera.weigh("hyq", frame, imu_frame=stadera.load_robot("hyq").trunk)  # type: ignore[arg-type]
    assert found.mass == pytest.approx(stadera.weigh("hyq", log).mass, rel=1e-6)


def test_identify_and_excite_take_names_and_paths(tmp_path: Path) -> None:
    short = stadera.ExciteSettings(duration=10.0, random=True)
    named, path = stadera.excite("hyq", "RH", short), stadera.load_robot("hyq").source
    assert stadera.excite(str(path), "RH", short).chosen.gain == named.chosen.gain
    with pytest.raises(stadera.RecordingError, match="no such file"):
        stadera.identify("hyq", tmp_path / "log.csv")
    with pytest.raises(stadera.UnknownNameError, match="unknown robot"):
        stadera.identify("hyqq", tmp_path / "log.csv")


def test_every_error_of_the_library_is_at_the_door() -> None:
    from stadera import errors

    named = {name for name, value in vars(errors).items() if isinstance(value, type) and issubclass(value, Exception)}
    assert named <= set(stadera.__all__)
