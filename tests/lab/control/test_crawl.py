"""Robots that crawl on what they measure: they get where they are sent, keep their margin, stop, and say why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.control.testbed import robot_named, walk_on
from stadera.errors import StaderaError
from stadera.lab.control.crawl import Crawl, CrawlPhase
from stadera.lab.control.monitor import WalkMonitor
from stadera.lab.control.stand import TestBed
from stadera.lab.control.steps import CrawlCommand, CrawlSettings
from stadera.lab.control.trunk import TrunkController
from stadera.lab.plant.payload import RigidMass, VirtualForce
from stadera.lab.plant.plant import Plant
from stadera.lab.plant.sensors import IDEAL, STANDARD, SensorErrors, Sensors
from stadera.lab.plant.terrain import Stones, Terrain
from stadera.robot import Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import TrunkModel


def crawler(
    robot: Robot,
    *,
    errors: SensorErrors = STANDARD,
    terrain: Terrain | None = None,
    command: CrawlCommand | None = None,
    load: RigidMass | VirtualForce | None = None,
    known: bool = True,
    settings: CrawlSettings | None = None,
) -> tuple[TestBed, Crawl, WalkMonitor]:
    """A crawl on the test-bed, asked to walk, its load known or not."""
    plant = Plant(robot, terrain)
    plant.reset(standing_configuration(robot))
    if load is not None:
        plant.apply_payload(load)
    belief = TrunkModel.of(plant.truth()) if known else TrunkModel.prior(robot)
    crawl = Crawl(TrunkController(robot, trunk=belief), settings, command)
    crawl.resume()
    return TestBed(plant, Sensors(errors, 3, robot), crawl, hold=2), crawl, WalkMonitor(plant)


def corner_load(robot: Robot, force: float) -> VirtualForce:
    """A weight at the left hind hip."""
    hip = robot.tree.translations[robot.tree.joints.index(robot.leg("LH").joints[0])]
    return VirtualForce(force, (float(hip[0]), float(hip[1]), float(hip[2])))


def test_walks_at_the_speed_it_is_told_with_a_load_it_knows() -> None:
    robot = robot_named("go2")
    test, crawl, judge = crawler(robot, load=corner_load(robot, 0.1 * robot.mass * 9.81))
    assert walk_on(test, 1.0 + crawl.settings.lead, judge) is None
    start = test.plant.state.position
    assert walk_on(test, crawl.settings.cycle, judge) is None
    assert (test.plant.state.position - start)[0] / crawl.settings.cycle == pytest.approx(0.1, rel=0.2)
    assert np.nanmin(judge.history["margin"]) > 0.5 * crawl.settings.margin
    assert np.rad2deg(judge.tilt()) < 1.0
    assert not crawl.failed
    swung = [event.leg for event in crawl.events if event.phase is CrawlPhase.SWING]
    assert swung[:4] == list(crawl.settings.sequence)


def test_an_unknown_load_takes_the_centre_of_mass_out_of_the_support() -> None:
    robot = robot_named("hyq")
    test, _, judge = crawler(robot, load=corner_load(robot, 100.0), known=False)
    fall = walk_on(test, 5.2, judge)
    assert fall is not None or np.nanmin(judge.history["margin"]) < 0.0


def test_stops_takes_a_new_trunk_without_a_jump_walks_on_and_stops_again() -> None:
    robot = robot_named("hyq")
    test, crawl, judge = crawler(robot, errors=IDEAL, load=corner_load(robot, 60.0), known=False)
    walk_on(test, 1.2, judge)
    assert crawl.phase is not CrawlPhase.STAND
    crawl.request_stop()
    walk_on(test, 1.6, judge)
    assert crawl.stopped
    assert crawl.reason == "asked to stop"
    assert test.plant.state.foot_contact.all()
    before, efforts = test.plant.state.position, [test.plant.effort]
    assert crawl.update_trunk(TrunkModel.of(test.plant.truth()))
    for _ in range(300):
        test.step()
        efforts.append(test.plant.effort)
    assert np.abs(np.diff(efforts, axis=0)).max() < 0.02 * 150.0
    assert np.linalg.norm(test.plant.state.position - before) < 0.01
    crawl.resume()
    assert walk_on(test, 1.5, judge) is None
    assert not crawl.stopped
    crawl.request_stop()
    walk_on(test, 2.0, judge)
    assert crawl.stopped
    assert not crawl.fault


def test_a_trunk_that_comes_on_the_way_is_walked_by() -> None:
    robot = robot_named("hyq")
    test, crawl, judge = crawler(robot)
    walk_on(test, 0.5, judge)
    assert crawl.phase is CrawlPhase.BODY
    test.plant.apply_payload(corner_load(robot, 100.0))
    assert crawl.update_trunk(TrunkModel.of(test.plant.truth()))
    assert walk_on(test, 2.5, judge) is None
    assert np.nanmin(judge.history["margin"]) > 0.5 * crawl.settings.margin
    assert sum(event.phase is CrawlPhase.SWING for event in crawl.events) >= 2


def test_a_trunk_that_wanders_costs_no_step() -> None:
    robot = robot_named("hyq")
    test, crawl, judge = crawler(robot)
    truth, rng, size = TrunkModel.of(test.plant.truth()), np.random.default_rng(0), 0.3 * crawl.settings.margin
    wandered = np.zeros(3)
    assert walk_on(test, 0.1, judge) is None
    for _ in range(round((crawl.settings.lead + 2.5) / 0.02)):  # fifty beliefs a second, of which some replan
        wandered += -0.05 * wandered + 0.3 * size * np.array([*rng.normal(size=2), 0.0])
        assert crawl.update_trunk(TrunkModel(truth.mass, truth.com_trunk + wandered))
        assert walk_on(test, 0.02, judge) is None
    step = crawl.steps.timing.step
    lifted = [event.time for event in crawl.events if event.phase is CrawlPhase.SWING]
    assert len(lifted) >= int(2.5 / step)
    assert np.diff(lifted).max() < 1.6 * step
    assert not crawl.failed
    assert np.nanmin(judge.history["margin"]) > 0.0


def test_a_trunk_that_comes_while_a_leg_swings_is_walked_by() -> None:
    robot = robot_named("hyq")
    test, crawl, judge = crawler(robot)
    while crawl.phase is not CrawlPhase.SWING:
        walk_on(test, 0.02, judge)
    test.plant.apply_payload(corner_load(robot, 60.0))
    assert crawl.update_trunk(TrunkModel.of(test.plant.truth()))
    assert walk_on(test, 2.5, judge) is None
    lifted = [event.time for event in crawl.events if event.phase is CrawlPhase.SWING]
    assert np.diff(lifted).max() < 1.6 * crawl.steps.timing.step
    assert not crawl.failed


def test_turns_and_takes_the_sequence_it_is_given() -> None:
    robot = robot_named("go2")
    settings = replace(CrawlSettings.of(robot), sequence=("RH", "RF", "LH", "LF"))
    test, crawl, judge = crawler(robot, command=CrawlCommand(0.05, 0.25), settings=settings)
    assert walk_on(test, 3.0, judge) is None
    rotation = test.plant.state.rotation
    assert np.arctan2(rotation[1, 0], rotation[0, 0]) > 0.4
    assert next(event.leg for event in crawl.events if event.phase is CrawlPhase.SWING) == "RH"


def test_walks_over_uneven_stones_on_a_ramp() -> None:
    robot = robot_named("hyq")
    terrain = Terrain(slope=np.deg2rad(10.0), stones=Stones(seed=2, height=0.05, level=0.45))
    test, crawl, judge = crawler(robot, terrain=terrain, load=corner_load(robot, 100.0))
    assert walk_on(test, 5.0, judge) is None
    assert not crawl.failed
    assert np.nanmin(judge.history["margin"]) > 0.0
    assert test.plant.state.position[0] > 0.3


def test_a_foot_that_finds_no_ground_goes_back_and_says_so() -> None:
    robot = robot_named("hyq")
    gap = Terrain(stones=Stones(size=0.35, height=0.0, level=0.4, length=(1.0, 0.45)))  # the ground ends ahead
    test, crawl, judge = crawler(robot, errors=IDEAL, terrain=gap)
    while not (crawl.failed and crawl.stopped):
        assert walk_on(test, 0.2, judge) is None
        assert test.plant.time < 9.0
    assert crawl.failed
    assert crawl.stopped
    assert "found no ground" in crawl.reason
    assert test.plant.state.foot_contact.all()


def test_refuses_what_cannot_be_walked() -> None:
    robot = robot_named("go2")
    settings = CrawlSettings.of(robot)
    with pytest.raises(StaderaError, match="too fast"):
        settings.timing(CrawlCommand(3.0))
