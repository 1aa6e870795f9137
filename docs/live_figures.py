"""Draws what a running robot looks like in the terminal and in Rerun: python docs/live_figures.py

Needs pip install '.[lab,live,view,models]', Chromium, and tornado to speak with it. A simulated Go2 trots, and a box
of 3 kg comes onto its back; the terminal is drawn as SVG, the viewer by Rerun's web viewer in a browser without a
screen.
"""

from __future__ import annotations

import asyncio
import base64
import io
import json
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

from rich.console import Console
from tornado.websocket import websocket_connect

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from live_client import imu, joint_state

from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import simulate
from stadera.live import Lag, LiveSession
from stadera.live.topics import Arrival
from stadera.live.view import Viewer
from stadera.logs import Recording
from stadera.logs.bags.decode import IMU, JOINT_STATE
from stadera.report.live import live_screen
from stadera.robot import load_robot

FOLDER = Path(__file__).parent / "figures"
LOADED_AT, TARE = 3.0, 2.5  # s
PORTS = {"data": 19876, "page": 19090, "browser": 19222}
WAIT = 120.0  # s, for software rendering to have drawn everything


def messages(log: Recording, rows: range) -> Iterator[Arrival]:
    """JointState and Imu of some samples, which arrive as soon as they are measured."""
    unit = log.imu
    assert unit is not None
    for k in rows:
        t = float(log.time[k])
        gyro, force = unit.angular_velocity[k].tolist(), unit.linear_acceleration[k].tolist()
        yield Arrival("/imu/data", IMU, round(1e9 * t), imu(t, gyro, force, unit.frame or ""), t)
        values = (channel[k].tolist() for channel in (log.position, log.velocity, log.effort))
        yield Arrival("/joint_states", JOINT_STATE, round(1e9 * t), joint_state(t, log.joints, *values), t)


def walk(path: Path) -> None:
    """Weighs the trot, with a viewer's file; draws the terminal at its end."""
    robot = load_robot("go2")
    settings = SimulateSettings("standard", Load(3.0), duration=5.0, rate=500.0, load_time=LOADED_AT)
    log: Recording = simulate(robot, "trot-load", settings).recording
    with Viewer(robot, save=path) as viewer:
        session, tared = LiveSession(robot, watch=viewer.watch), False
        for start in range(0, len(log), 10):
            session.feed(messages(log, range(start, min(start + 10, len(log)))))
            if not tared and log.time[start] > TARE:
                tared = session.tare().success
            state = session.state(float(log.time[start]))
    console = Console(record=True, width=96, file=io.StringIO())
    console.print(live_screen(replace(state, lag=Lag())))  # nothing runs in real time here
    drawn = console.export_svg(title="stadera live --robot go2")
    drawn = re.sub(r"@font-face \{.*?\}", "", drawn, flags=re.DOTALL)  # nothing is fetched from elsewhere
    (FOLDER / "live_terminal.svg").write_text(drawn, encoding="utf-8")


async def photographed(address: str, path: Path) -> None:
    """A page as Chromium shows it after a while."""
    flags = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=1600,1000"]
    with tempfile.TemporaryDirectory() as profile:
        command = ["chromium", "--headless=new", "--no-sandbox", *flags, f"--user-data-dir={profile}"]
        command += [f"--remote-debugging-port={PORTS['browser']}", address]
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            await asyncio.sleep(WAIT)
            with urllib.request.urlopen(f"http://127.0.0.1:{PORTS['browser']}/json") as answer:
                page = next(page for page in json.load(answer) if page["type"] == "page")
            socket = await websocket_connect(page["webSocketDebuggerUrl"], max_message_size=100 << 20)
            await socket.write_message(json.dumps({"id": 1, "method": "Page.captureScreenshot"}))
            while (answer := json.loads(await socket.read_message())).get("id") != 1:
                pass
            path.write_bytes(base64.b64decode(answer["result"]["data"]))
        finally:
            browser.terminate()
            browser.wait()


def main() -> None:
    """Weighs, draws, writes."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "go2.rrd"
        walk(scene)
        rerun = [str(Path(sys.executable).with_name("rerun")), str(scene), "--web-viewer", "--bind", "127.0.0.1"]
        rerun += ["--port", str(PORTS["data"]), "--web-viewer-port", str(PORTS["page"])]
        server = subprocess.Popen(rerun, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            time.sleep(10.0)
            data = quote(f"rerun+http://127.0.0.1:{PORTS['data']}/proxy", safe="")
            page = f"http://127.0.0.1:{PORTS['page']}/?url={data}"
            asyncio.run(photographed(page, FOLDER / "live_viewer.png"))
        finally:
            server.terminate()
            server.wait()


if __name__ == "__main__":
    main()
