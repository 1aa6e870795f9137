"""MuJoCo's warnings, kept out of the working folder: by default it appends them to a file MUJOCO_LOG.TXT there."""

from __future__ import annotations


def keep_quiet() -> None:
    """Drops MuJoCo's warnings, unless this process handles them in its own way.

    What they warn of is found by this package itself: a model that does not compile, a motion that runs away.
    """
    import mujoco

    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_drop)


def _drop(text: str) -> None:
    pass
