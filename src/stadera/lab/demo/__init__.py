"""The demo: a box is dropped onto the back of a walking robot, with and without identification."""

from stadera.lab.demo.run import DemoResult, DemoRun, DemoSettings, one_run, run_demo

__all__ = ["DemoResult", "DemoRun", "DemoSettings", "one_run", "run_demo"]
