"""Keeps MuJoCo's warnings out of the working folder, where by default they are appended to MUJOCO_LOG.TXT."""


def keep_quiet() -> None:
    """Discards MuJoCo's warnings, unless this process has its own handler.

    This package detects their causes itself: a model that does not compile, a motion that diverges.
    """
    import mujoco

    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_drop)


def _drop(text: str) -> None:
    pass
