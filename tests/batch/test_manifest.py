"""Manifests name recordings by folders, patterns and tables only."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from batch_recordings import simulated
from ospc.batch.manifest import Entry, options_of, read_manifest
from ospc.errors import FormatError, RecordingError, SettingError
from ospc.recording.channel import Channel


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    place = tmp_path_factory.mktemp("recordings")
    original = simulated(place / "left" / "a", 0, frames=2)
    for name in ("left/b", "right/deep/c"):
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).symlink_to(original)
    (place / "left" / "notes").mkdir()
    (place / "left" / "notes" / "readme.txt").write_text("no recording")
    return place


def test_a_folder_is_searched_and_folders_name_cameras(recordings):
    found = read_manifest(str(recordings))
    assert [(entry.recording, entry.camera) for entry in found] == [
        (str(recordings / "left" / "a"), "left"),
        (str(recordings / "left" / "b"), "left"),
        (str(recordings / "right" / "deep" / "c"), "deep"),
    ]
    assert {entry.camera for entry in read_manifest(str(recordings), camera="mine")} == {"mine"}


def test_a_recording_is_a_batch_of_one(recordings):
    place = recordings / "left" / "a"
    assert [entry.recording for entry in read_manifest(str(place))] == [str(place)]


def test_videos_are_found_in_their_folders(tmp_path):
    for place in ("a/film.avi", "b/c/d/film.avi", "b/c/d/e/film.avi"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_bytes(b"RIFF\0\0\0\0AVI ")
    reasons = []
    found = read_manifest(str(tmp_path), left_out=reasons.append)
    assert [(entry.recording, entry.camera) for entry in found] == [
        (str(tmp_path / "a" / "film.avi"), "a"),
        (str(tmp_path / "b" / "c" / "d" / "film.avi"), "d"),
    ]
    (reason,) = reasons
    assert reason.startswith(
        f"{tmp_path / 'b' / 'c' / 'd' / 'e'}: is not searched, because its content is more than 4"
    )


def test_a_folder_that_cannot_be_read_is_left_out(tmp_path, monkeypatch):
    original = simulated(tmp_path / "a", 0, frames=2)
    locked = tmp_path / "lost+found"
    locked.mkdir()

    def denied(of):
        def call(path, *args, **named):
            if (of == "iterdir" and path == locked) or path.parent == locked:
                raise PermissionError(errno.EACCES, "Permission denied", str(path))
            return before(path, *args, **named)

        before = getattr(Path, of)
        return call

    for name in ("iterdir", "stat"):
        monkeypatch.setattr(Path, name, denied(name))
    reasons = []
    assert [entry.recording for entry in read_manifest(str(tmp_path), left_out=reasons.append)] == [str(original)]
    assert reasons == [f"{locked}: cannot be read (Permission denied)"]


def test_a_pattern_is_expanded(recordings):
    found = read_manifest(str(recordings / "left" / "?"))
    assert [entry.recording for entry in found] == [str(recordings / "left" / name) for name in "ab"]


CSV = "camera,recording,options,weather\nA,left/a,rounds=4 kind=tum_mono,rain\n,/elsewhere/b,,\nA,s3://bucket/x/c,,\n"


def test_a_table_has_paths_relative_to_itself_and_options(recordings):
    (recordings / "m.csv").write_text(CSV)
    first, second, third = read_manifest(str(recordings / "m.csv"))
    assert first == Entry(str(recordings / "left" / "a"), "A", (("rounds", "4"), ("kind", "tum_mono")))
    assert (first.settings.rounds, first.kind) == (4, "tum_mono")
    assert second == Entry("/elsewhere/b", "camera")
    assert third.recording == "s3://bucket/x/c"
    assert third.is_remote


def test_recordings_named_twice_are_one(recordings):
    (recordings / "twice.csv").write_text("recording\nleft/a\nleft/a\n")
    assert len(read_manifest(str(recordings / "twice.csv"))) == 1


def test_options_of_an_entry_go_before_those_of_the_command():
    entry = Entry("r", "A", options_of("rounds=4")).with_defaults({"rounds": "2", "channel": "red"})
    assert entry.settings.rounds == 4
    assert entry.reading.channel is Channel.RED


@pytest.mark.parametrize(
    ("content", "error", "said"),
    [
        (b"camera\nA\n", FormatError, "no column recording"),
        (b"recordings;camera\nr0;A\n", FormatError, "'recordings', 'camera'.*separated by commas or semicolons"),
        (b"recording;camera\nr0;A;b\n", FormatError, "row 2: has more cells .* quote cells with semicolons"),
        (b"", FormatError, "no column recording"),
        (b'recording\n""\n', FormatError, "row 2: names no recording"),
        (b"recording\na\0b\n", FormatError, "names no recording|cannot be read as CSV"),
        (b"recording,options\na,rounds\n", SettingError, "row 2: option 'rounds' is not NAME=VALUE"),
        (b"recording,options\na,no_such=1\n", SettingError, "m.csv, row 2: .*a: no setting is called 'no_such'"),
        (b"recording,options\na,unknown_exposures=true\n", SettingError, "no setting is called 'unknown_exposures'"),
        (b"recording,options\na,exposure_unt=us\n", SettingError, r"did you mean exposure_unit\b"),
        (b"recording,options\na,\nb,correctlag=1\n", SettingError, r"row 3: .*did you mean correct_lag\?"),
        (b"recording,options\na,channel=ultraviolet\n", SettingError, "option channel must be one of luminance"),
        (b"recording\n", RecordingError, "no recordings there"),
        (b'recording\n"a', FormatError, "cannot be read as CSV"),
        (b"recording,camera\na,1/b,left\n", FormatError, "row 2: has more cells .* quote paths with commas"),
        (b"\xff\xfe\x00", FormatError, "is not UTF-8 text"),
    ],
)
def test_tables_that_make_no_sense_are_refused(tmp_path, content, error, said):
    (tmp_path / "m.csv").write_bytes(content)
    with pytest.raises(error, match=said):
        read_manifest(str(tmp_path / "m.csv"))


def test_semicolons_separate_as_well_and_then_commas_do_not(recordings):
    (recordings / "m.csv").write_text(CSV)
    rows = CSV.replace(",", ";").replace("left/a", "left/a,b").replace("rounds=4 kind", '"rounds=4;kind').splitlines()
    (recordings / "s.csv").write_text("\n".join([rows[0], rows[1].replace("tum_mono", 'tum_mono"'), *rows[2:], ""]))
    first, *others = read_manifest(str(recordings / "m.csv"))
    assert read_manifest(str(recordings / "s.csv")) == [
        Entry(f"{first.recording},b", first.camera, first.options),
        *others,
    ]


def test_empty_cells_at_the_end_of_a_row_are_ignored(tmp_path):
    (tmp_path / "m.csv").write_text("recording,camera\na,left,,\n")
    assert [entry.camera for entry in read_manifest(str(tmp_path / "m.csv"))] == ["left"]


def test_what_is_not_there_is_refused(tmp_path):
    for manifest in ("none", "none.csv", "none/*"):
        with pytest.raises(RecordingError, match="none"):
            read_manifest(str(tmp_path / manifest))


def test_outputs_beside_recordings_are_left_out(tmp_path):
    original = simulated(tmp_path / "a", 0, frames=2)
    for name, file in (("result", "state.ospc"), ("linear", "correction.json")):
        (tmp_path / name).mkdir()
        (tmp_path / name / file).write_text('{"schema": "ospc-correction/2"}')
    reasons = []
    assert [entry.recording for entry in read_manifest(str(tmp_path), left_out=reasons.append)] == [str(original)]
    assert reasons == [
        f"{tmp_path / name}: is the output of a calibration or correction" for name in ("linear", "result")
    ]
