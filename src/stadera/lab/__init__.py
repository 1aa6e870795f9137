"""The laboratory: a MuJoCo test-bed, controllers, baselines, the paper's experiments. Simulations need extra `lab`."""

from importlib.util import find_spec

from stadera.errors import MissingExtraError

_PACKAGES = ("mujoco", "proxsuite")


def require_lab(purpose: str) -> None:
    """Checks that the packages of the extra `lab` are installed."""
    if missing := [package for package in _PACKAGES if find_spec(package) is None]:
        raise MissingExtraError(" ".join(missing), "lab", purpose)
