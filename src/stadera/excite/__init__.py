"""Excitation trajectories for leg identification; the package can be called: `stadera.excite(robot, leg)`."""

from stadera.lazy import make_callable

make_callable(__name__, "stadera.excite.design")
