"""`stadera live`: weighs a running robot, with its topics over Zenoh."""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli import options as opt
from stadera.cli.options import LogOptions, RobotOptions, argument, grouped, option, remembered
from stadera.cli.outputs import REPLAY, check_outputs
from stadera.cli.terminal import show
from stadera.errors import StaderaError

if TYPE_CHECKING:
    from stadera.live import Answer, LiveSession, LiveState
    from stadera.logs.topics import LogFile


@grouped
def live(
    robot: opt.RobotName,
    source: Annotated[str, argument("zenoh|replay:LOG", "Source of the messages.")] = "zenoh",
    connect: Annotated[
        list[str] | None, option("ENDPOINT", "Zenoh endpoint to connect to; repeatable [default: tcp/localhost:7447].")
    ] = None,
    listen: Annotated[list[str] | None, option("ENDPOINT", "Zenoh endpoint to listen on; repeatable.")] = None,
    config: Annotated[Path | None, option("F.json5", "Zenoh configuration file.")] = None,
    rate: Annotated[float, option("X", "Speed of a replay: X times as fast; or inf.", min=0.001)] = 1.0,
    tare: Annotated[
        float | None, option("SECONDS", "Tare so long after the first sample; else by stadera/tare.", min=0.0)
    ] = None,
    record: Annotated[Path | None, option("F.mcap", "Record received and sent messages.")] = None,
    *,
    weighed: RobotOptions,
    options: LogOptions,
) -> None:
    """Weigh a running robot: joint states and IMU in, trunk and payload out, until Ctrl-C.

    In: sensor_msgs/JointState and Imu, or Unitree's LowState, from rmw_zenoh or zenoh-bridge-ros2dds, found by type.
        Out, ten times a second: stadera/trunk and stadera/payload (InertiaStamped), stadera/state (JSON),
        stadera/diagnostics; and the services stadera/tare and stadera/reset.
    """
    if source != "zenoh" and not source.startswith(REPLAY):
        raise typer.BadParameter(f"{source!r} is neither zenoh nor {REPLAY}LOG", param_hint="SOURCE")
    if source == "zenoh" and options.columns is not None:
        raise typer.BadParameter("messages have no columns: it is for logs that are replayed", param_hint="--columns")
    on_scale = weighed.on_scale
    log = options.log(Path(source.removeprefix(REPLAY))) if source != "zenoh" else None

    from stadera.files import written_together
    from stadera.live import LiveSession
    from stadera.live.link import Endpoints
    from stadera.live.run import run
    from stadera.logs.topics import AS_RECORDED
    from stadera.report.live import live_summary

    model = weighed.model(robot, options.reading.limits)
    check_outputs((record, weighed.rrd, weighed.memory))
    known = remembered(weighed.memory, model)
    where = Endpoints(tuple(connect or ()), tuple(listen or ()), config)
    with weighed.watching(model) as watch, written_together([] if record is None else [record]) as drafts:
        reading = options.reading if log is None else AS_RECORDED  # a log is read with it
        session = LiveSession(
            model, options.topics, weighed.imu_frame, watch=watch, reading=reading, fix=options.fix, weight=on_scale,
            tare_after=tare, memory=known, at=weighed.at,
        )  # fmt: skip
        with _until_stopped() as stop, _shown(session.tare) as sink:
            last = run(session, where, options.topics, stop, [sink], drafts[0] if drafts else None, log, rate)
    show(live_summary(last))
    if weighed.memory is not None:
        learnt, said = session.remembered()
        if learnt is not None:
            learnt.save_json(weighed.memory)
        show(said)
    _require_done(session, last, log)


def _require_done(session: LiveSession, last: LiveState, log: LogFile | None) -> None:
    """Raises StaderaError: no sample of a log was used, or the tare that was asked for was never taken."""
    if log is not None and isnan(last.time):
        raise StaderaError(f"{log}: nothing is weighed, for want of {'; '.join(last.waiting_for) or 'samples'}")
    if session.tare_after is not None:
        end = "before any sample" if isnan(last.time) else f"at {last.since(last.time):.2f} s"
        raise StaderaError(f"never tared: --tare {session.tare_after:g} was not possible until the end {end}")


@contextmanager
def _until_stopped() -> Iterator[threading.Event]:
    stop = threading.Event()
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _shown(tare: Callable[[], Answer]) -> Iterator[Callable[[LiveState], None]]:
    """Yields the function that shows states: a screen on a terminal, where the key t tares, else one line for each
    event. It calls `tare` in the thread that calls it.
    """
    from stadera.report.live import live_lines, live_screen

    if sys.stdout.isatty():
        from rich.live import Live

        with Live(auto_refresh=False) as screen, _keys() as pressed:
            hint = "t: tare, Ctrl-C: end" if sys.stdin.isatty() else ""
            below = [hint]

            def update(state: LiveState) -> None:
                if "t" in pressed().lower():
                    below[0] = f"{hint}; {tare().message}"
                screen.update(live_screen(state, below[0]), refresh=True)

            yield update
        return
    before: list[LiveState | None] = [None]

    def lines(state: LiveState) -> None:
        for line in live_lines(state, before[0]):
            print(line, flush=True)
        before[0] = state

    yield lines


@contextmanager
def _keys() -> Iterator[Callable[[], str]]:
    """Yields the function that returns what was typed since its last call; nothing if stdin is no terminal."""
    try:
        import termios
        import tty
    except ImportError:  # not on Windows
        yield str
        return
    if not sys.stdin.isatty():
        yield str
        return
    stream, before = sys.stdin.fileno(), termios.tcgetattr(sys.stdin)
    tty.setcbreak(stream)  # keys without Enter; Ctrl-C still interrupts
    try:
        yield lambda: os.read(stream, 64).decode(errors="ignore") if select.select([stream], [], [], 0)[0] else ""
    finally:
        termios.tcsetattr(stream, termios.TCSADRAIN, before)
