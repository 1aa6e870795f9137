"""Identification of the legs from logs; the package can be called: `stadera.identify(robot, logs)`."""

from stadera.lazy import make_callable

make_callable(__name__, "stadera.identify.legs")
