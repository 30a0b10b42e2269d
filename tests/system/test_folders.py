"""Unusable output folders are rejected before the work starts, and only one process writes to a folder."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import nullcontext

import pytest

from command_line import ospc
from ospc.errors import SettingError
from ospc.report.output_folder import OWN_NAMES, OutputFolder
from ospc.system.folders import Content, check_usable, reserved

HOLDER = """
import sys
from ospc.system.folders import reserved
with reserved(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def another_process_in():
    """Return a function that starts another process, which reserves a folder until the test ends."""
    holders = []

    def hold(folder):
        command = [sys.executable, "-c", HOLDER, str(folder)]
        holders.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
        assert holders[-1].stdout.readline() == "held\n"
        return holders[-1]

    yield hold
    for holder in holders:
        holder.communicate()


def test_a_second_process_is_refused_with_one_sentence_until_the_first_ends(tmp_path, another_process_in):
    out = tmp_path / "out"
    holder = another_process_in(out)
    with pytest.raises(SettingError, match="another process is writing to it; wait"), reserved(out):
        pass
    other_way = tmp_path / "link"
    other_way.symlink_to(out)
    with pytest.raises(SettingError, match="another process"), reserved(other_way):
        pass
    holder.kill()
    holder.wait()
    with reserved(out):
        pass


@pytest.mark.parametrize(
    "words",
    [
        ["calibrate", "nothing", "-o"],
        ["merge", "nothing", "-o"],
        ["batch", "nothing", "-o"],
        ["convert", "nothing", "-o"],
        ["correct", "nothing", "nothing", "-o"],
        ["demo", "-o"],
        ["simulate"],
        ["record", "opencv:9", "-o"],
        ["bench", "accuracy", "-o"],
        ["experiments", "static", "-o"],
    ],
    ids=lambda words: words[0],
)
def test_every_command_that_writes_a_folder_reserves_it(words, tmp_path, another_process_in):
    another_process_in(tmp_path / "out")
    result = ospc(*words, tmp_path / "out")
    assert result.exit_code == 1
    assert "another process is writing to it" in str(result.exception)
    dangling = tmp_path / "dangling"
    dangling.symlink_to(tmp_path / "nowhere")
    result = ospc(*words, dangling)
    assert "is a broken link" in str(result.exception)


def test_an_unused_new_folder_is_removed_and_any_other_stays(tmp_path):
    with pytest.raises(ZeroDivisionError), reserved(tmp_path / "a" / "b"):
        _ = 1 / 0
    assert not (tmp_path / "a").exists()
    (tmp_path / "empty").mkdir()
    with reserved(tmp_path / "empty"), reserved(tmp_path / "used") as used:
        (used / "result").touch()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "used"]


def test_a_lock_leaves_no_file(tmp_path):
    with reserved(tmp_path / "out") as out:
        assert list(out.iterdir()) == []


@pytest.mark.parametrize(
    ("allowed", "forced", "refusal"),
    [
        ("always", False, None),
        ("with force", True, None),
        ("with force", False, "contains letters; choose another folder, or force writing to it"),
        ("never", False, "contains letters; choose another folder$"),
        ("never", True, "contains letters; choose another folder$"),
    ],
)
def test_content_allows_new_output_always_with_force_or_never(tmp_path, allowed, forced, refusal):
    letters = Content("contains letters", allowed)
    check_usable(tmp_path, content_of=lambda _place: letters, force=forced)  # empty
    check_usable(tmp_path / "new", content_of=lambda _place: letters, force=forced)
    (tmp_path / "letter.txt").write_text("mine")
    with pytest.raises(SettingError, match=refusal) if refusal else nullcontext():
        check_usable(tmp_path, content_of=lambda _place: letters, force=forced)
    assert (tmp_path / "letter.txt").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_what_cannot_be_written_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(SettingError, match="not writable"), reserved(tmp_path / "out"):
        pass


def test_links_to_nothing_and_folders_in_the_place_of_files_are_found_before_the_work(tmp_path):
    dangling = tmp_path / "dangling"
    dangling.symlink_to(tmp_path / "nowhere")
    with pytest.raises(SettingError, match="is a broken link"):
        OutputFolder.at(dangling)
    (tmp_path / "out" / OWN_NAMES[0]).mkdir(parents=True)
    with pytest.raises(SettingError, match="is a folder, but a file must be written there"):
        OutputFolder.at(tmp_path / "out", force=True)
    result = ospc("compare", tmp_path, tmp_path, "--plot", tmp_path / "none" / "a.png")
    assert "does not exist; make it, or choose another one" in str(result.exception)


def test_leftovers_of_a_killed_process_are_removed(tmp_path, another_process_in):
    busy = tmp_path / "busy"
    names = [".a.json.123.part", "inner/.b.png.9.part", "busy/.c.json.7.part", ".part", ".notes.part", "a.1.part"]
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"half")
    another_process_in(busy)
    (busy / ".c.json.7.part").write_bytes(b"that process is writing it")
    with reserved(tmp_path):
        left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {"busy/.c.json.7.part", ".part", ".notes.part", "a.1.part"}


@pytest.mark.parametrize("inside", [".", "images", "rig/left"])
def test_a_folder_around_the_recording_is_no_output_folder(tmp_path, inside):
    """Its lists of exposures and parameters, such as times.txt, may belong to the recording."""
    (tmp_path / inside).mkdir(parents=True, exist_ok=True)
    (tmp_path / "times.txt").write_text("0 0.0 1.0\n")
    with pytest.raises(SettingError, match="contains the recording itself"):
        OutputFolder.at(tmp_path, recording=tmp_path / inside, force=True)
