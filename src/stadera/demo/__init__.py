"""The demo: a box lands on the back of a robot that walks, with and without identification."""

from stadera.demo.film import Camera, Film
from stadera.demo.run import DemoResult, DemoRun, DemoSettings, one_run, run_demo

__all__ = ["Camera", "DemoResult", "DemoRun", "DemoSettings", "Film", "one_run", "run_demo"]
