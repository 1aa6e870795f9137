"""Python's collector of cyclic garbage in processes that belong to this package: the command, and a fleet's workers."""

import atexit
import gc

_NEW = 50_000  # objects more than at the last collection, before the next one; Python's own is 700


def collect_rarely() -> None:
    """Makes collections rare, and leaves out those at the process's end. Each looks through all new objects, or through
    all there are, and packages that are imported bring 150,000, of which none is garbage: of the time of `stadera
    weigh` on a short log, an eighth before the end and a fifth at it.

    Arrays and what holds them are freed when the last reference goes; what refers to itself waits for a collection.
    """
    gc.set_threshold(_NEW)
    atexit.register(gc.freeze)


def keep_loaded() -> None:
    """Leaves all objects that there are out of later collections; at the first call only, after a first task has loaded
    modules, compiled functions and models. Does nothing in a process without `collect_rarely`, such as a worker of
    somebody else's scheduler.
    """
    if gc.get_threshold()[0] == _NEW and not gc.get_freeze_count():
        gc.freeze()
