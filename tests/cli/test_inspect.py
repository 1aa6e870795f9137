"""`stadera inspect`."""

from __future__ import annotations

from stadera.logs import take, write_table
from stadera.robot import load_robot


def test_a_robot_shows_its_links_and_joints(run):
    finished = run("inspect", "hyq")
    robot = load_robot("hyq")
    assert finished.code == 0
    for name in (*robot.tree.links, *robot.tree.joints):
        assert name in finished.out
    assert "2.638" in finished.out  # kg, an upper leg


def test_a_log_shows_its_rate_and_whose_it_is(run, log, swing):
    finished = run("inspect", log)
    assert finished.code == 0
    assert "250 Hz" in finished.out
    assert f"{len(swing)} samples" in finished.out
    assert "hyq (RH)" in finished.out
    assert f"{swing.joints[0]}.effort" in finished.out


def test_neither_a_file_nor_a_robot(run):
    finished = run("inspect", "nosuch")
    assert finished.code == 1
    assert finished.err.startswith("stadera: error: nosuch: neither a file nor a robot's name; robots: hyq, ")
    assert finished.err.count("\n") == 1


def test_options_that_do_nothing_are_refused(run, log):
    for options in (("go2", "--robot", "go2"), ("go2", "hyq", "--robot", "go2"), ("go2", "--units", "ms")):
        finished = run("inspect", *options)
        assert finished.code == 2
        assert f"{options[-2]}: is for a log" in finished.err
    assert "--fix: needs --robot" in run("inspect", log, "--fix").err


def test_a_file_that_is_no_robot(run, tmp_path):
    path = tmp_path / "page.xml"
    path.write_text("<html></html>")
    finished = run("inspect", path)
    assert finished.code == 1
    assert "<html>" in finished.err


def test_gaps_of_a_log_are_told(run, swing, tmp_path):
    path = write_table(take(swing, (swing.time < 2.0) | (swing.time > 2.5)), tmp_path / "gap.csv")
    finished = run("inspect", path)
    assert "1: 0.508 s at 1.996 s" in finished.out
