"""The demo: a box lands on the back of a robot that walks, with and without identification."""

from stadera.lab.demo.run import DemoResult, DemoRun, DemoSettings, one_run, run_demo

__all__ = ["DemoResult", "DemoRun", "DemoSettings", "one_run", "run_demo"]
