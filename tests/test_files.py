"""Files that appear whole or not at all, and never on an input or on what is no regular file."""

from __future__ import annotations

import errno
import os
import signal
import socket
import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from stadera.errors import StaderaError
from stadera.files import output_gate, require_writable, written_together
from stadera.logs import Recording, write_table


def write(text: str, *paths: Path, fails: BaseException | None = None) -> None:
    with written_together(paths) as drafts:
        for draft in drafts:
            draft.write_text(text)
        if fails:
            raise fails


@pytest.mark.parametrize("error", [ZeroDivisionError(), KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left")])
def test_all_appear_or_none(tmp_path: Path, error: BaseException) -> None:
    old, new = tmp_path / "old.json", tmp_path / "new.html"
    write("first", old)
    expected = StaderaError if isinstance(error, OSError) else type(error)
    with pytest.raises(expected):
        write("second", old, new, fails=error)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["first"]
    write("second", old, new)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.html", "old.json"]
    assert {path.read_text() for path in tmp_path.iterdir()} == {"second"}


def test_the_old_file_outlives_a_process_that_is_killed_while_it_writes(tmp_path: Path) -> None:
    old, begun = tmp_path / "old.json", tmp_path / "begun"
    write("first", old)
    code = (
        "import sys, time, pathlib\nfrom stadera.files import written_together\n"
        f"with written_together([{str(old)!r}]) as (draft,):\n"
        f"    draft.write_text('half'); pathlib.Path({str(begun)!r}).touch(); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as process:
        while not begun.exists():
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert old.read_text() == "first"
    write("second", old)
    assert old.read_text() == "second"


def test_a_full_disk_is_noticed_before_the_old_file_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = tmp_path / "old.json"
    write("first", old)

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StaderaError, match=r"old\.json: cannot be written: No space left on device"):
        write("second", old)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["first"]


def test_a_draft_that_was_not_filled_is_named_by_its_file(tmp_path: Path) -> None:
    path = tmp_path / "o.json"
    with pytest.raises(StaderaError, match=r"/o\.json: cannot be written: nothing"), written_together([path]):
        pass
    assert list(tmp_path.iterdir()) == []


def test_bad_paths_are_named(tmp_path: Path) -> None:
    with pytest.raises(StaderaError, match="no such folder"):
        write("", tmp_path / "no" / "o.json")
    with pytest.raises(StaderaError, match="is a folder"):
        write("", tmp_path)
    with pytest.raises(StaderaError, match="named for two outputs"):
        write("", tmp_path / "o", tmp_path / "." / "o")
    with pytest.raises(StaderaError, match="name too long"):
        write("", tmp_path / ("x" * 300))
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(StaderaError, match="cannot be written"):
        write("", tmp_path / "loop")
    assert [path.name for path in tmp_path.iterdir()] == ["loop"]


def test_names_as_long_as_a_file_system_takes_them(tmp_path: Path) -> None:
    for path in (tmp_path / ("x" * 250 + ".json"), tmp_path / ("x." + "y" * 253)):
        write("text", path)
        assert path.read_text() == "text"


def test_what_is_no_regular_file_stays_what_it_is(tmp_path: Path) -> None:
    pipe, device, door = tmp_path / "pipe.json", tmp_path / "device.json", tmp_path / "s"
    os.mkfifo(pipe)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(door))
        places = [pipe, door]
        try:
            os.mknod(device, stat.S_IFCHR | 0o666, os.makedev(1, 3))
            places.append(device)
        except PermissionError:
            pass
        (tmp_path / "link").symlink_to(places[-1])
        before = {path: path.stat().st_mode for path in places}
        for path in (*places, tmp_path / "link"):
            with pytest.raises(StaderaError, match="is a pipe, socket or device"):
                write("text", path)
        assert {path: path.stat().st_mode for path in places} == before
    for name in ("/dev/null", "/dev/stdout", "/dev/../dev/null", "/proc/self/fd/1"):
        with pytest.raises(StaderaError, match="is no place for a file"):
            require_writable(name)


def test_links_are_followed_and_permissions_kept(tmp_path: Path) -> None:
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("first")
    real.chmod(0o640)
    link.symlink_to(real.name)
    write("second", link)
    assert link.is_symlink()
    assert (real.read_text(), stat.S_IMODE(real.stat().st_mode)) == ("second", 0o640)


def test_no_path_leads_onto_an_input(tmp_path: Path) -> None:
    log, bag = tmp_path / "log.csv", tmp_path / "bag"
    bag.mkdir()
    for path in (log, bag / "a.mcap"):
        path.write_text("data")
    (tmp_path / "soft.json").symlink_to(log)
    (tmp_path / "hard.json").hardlink_to(log)
    with output_gate([log, bag, tmp_path / "nowhere"]) as gate:
        for path in (log, tmp_path / "soft.json", tmp_path / "hard.json", bag / "a.mcap", bag / ".." / "log.csv"):
            with pytest.raises(StaderaError, match="would replace an input"):
                write("text", path)
        write("text", tmp_path / "new.json")
        write("text", tmp_path / "new.json")
        assert gate.written == [(tmp_path / "new.json", False), (tmp_path / "new.json", True)]
    assert log.read_text() == "data"
    write("text", log)


WRITES = """
import resource, sys
from stadera.errors import StaderaError
from stadera.files import written_together
from stadera.logs import read, write_table
logs = {path: read(path) for path in sys.argv[2:]}
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
for path, log in logs.items():
    try:
        write_table(log, path)
    except StaderaError as error:
        print(error)
try:
    with written_together([sys.argv[1]]) as (draft,):
        draft.write_text("x" * 100_000)
except StaderaError as error:
    print(error)
"""


def test_old_files_outlive_a_disk_that_takes_no_more(tmp_path: Path) -> None:
    old = [tmp_path / name for name in ("old.json", "old.parquet", "old.csv")]
    write("first", old[0])
    for path in old[1:]:
        write_table(Recording(np.arange(2000) / 500, ("a",), np.random.default_rng(0).normal(size=(2000, 1))), path)
    before = {path: path.read_bytes() for path in old}
    done = subprocess.run([sys.executable, "-c", WRITES, *map(str, old)], capture_output=True, text=True)
    assert [line.split(": ")[0] for line in done.stdout.splitlines()] == [str(old[k]) for k in (1, 2, 0)]
    assert done.stdout.count("File too large") == 3
    assert done.stderr == ""
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_old_file_outlives_an_interrupted_command(tmp_path: Path) -> None:
    old, begun = tmp_path / "old.json", tmp_path / "begun"
    write("first", old)
    code = (
        # whoever starts tests in the background may have SIGINT ignored, and children inherit that
        "import signal, time, pathlib\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from stadera.files import written_together\n"
        f"with written_together([{str(old)!r}]) as (draft,):\n"
        f"    draft.write_text('half'); pathlib.Path({str(begun)!r}).touch(); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL) as process:
        while not begun.exists():
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
    assert old.read_text() == "first"
    assert sorted(os.listdir(tmp_path)) == ["begun", "old.json"]
