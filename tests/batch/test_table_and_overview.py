"""The table and the page of a batch: everything in them, nothing misread, nothing executed."""

from __future__ import annotations

import csv
from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrations import calibration
from ospc.batch.cameras import Camera, folder_name
from ospc.batch.overview import page
from ospc.batch.table import Row, read_table, write_csv, write_parquet
from ospc.errors import FormatError
from ospc.pooling.agreement import Difference

TEXTS = st.text(st.characters(blacklist_categories=("Cs", "Cc")), max_size=20)
ROWS = st.builds(
    Row,
    TEXTS,
    TEXTS,
    st.sampled_from(["done", "failed", "not done"]),
    error=TEXTS,
    attempts=st.integers(0, 5),
    seconds=st.floats(0, 1e6),
    frames=st.integers(0, 10**9),
    response_sigma=st.none() | st.floats(0, 1),
)
WRITERS = {"csv": write_csv, "parquet": write_parquet}


@pytest.mark.parametrize("kind", WRITERS)
@given(rows=st.lists(ROWS, max_size=4))
def test_what_is_written_is_read_again(kind, rows, tmp_path_factory):
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    place = tmp_path_factory.mktemp("table") / f"batch.{kind}"
    assert read_table(WRITERS[kind](rows, place)) == rows


@pytest.mark.parametrize("kind", WRITERS)
def test_tables_of_other_versions_are_refused(kind, tmp_path, monkeypatch):
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    monkeypatch.setattr("ospc.batch.table.SCHEMA", "ospc-batch-table/0")
    place = WRITERS[kind]([Row("r", "c", "done")], tmp_path / f"batch.{kind}")
    monkeypatch.undo()
    with pytest.raises(FormatError, match=r"another version \(schema 'ospc-batch-table/0'.*run 'ospc batch' again"):
        read_table(place)


@pytest.mark.parametrize("text", ["recording\na\n", "", "schema,recording\nospc-batch-table/1,a\n"])
def test_other_tables_are_refused(tmp_path, text):
    (tmp_path / "batch.csv").write_text(text)
    with pytest.raises(FormatError, match="table of a batch"):
        read_table(tmp_path / "batch.csv")


def test_the_csv_is_plain(tmp_path):
    write_csv([Row("a, b", 'say "x"', "failed", error="no")], tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="") as stream:
        (row,) = csv.DictReader(stream)
    assert (row["recording"], row["camera"], row["error"], row["vignette_sigma"]) == ("a, b", 'say "x"', "no", "")


class Order(HTMLParser):
    """Collects headings and tags."""

    def __init__(self):
        super().__init__()
        self.headings, self.tags, self._inside = [], set(), False

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self._inside = self._inside or tag in ("h2", "h3")

    def handle_data(self, data):
        if self._inside and data.strip():
            self.headings.append(data)

    def handle_endtag(self, tag):
        if tag in ("h2", "h3"):
            self._inside = False


def test_failures_come_first_and_good_cameras_last():
    known = calibration()
    differing = (Difference("r9", "r9", ("vignette",), 9.0, "another lens"),)
    cameras = [
        Camera("good", "cameras/good", 3, 0, known),
        Camera("split", "cameras/split", 9, 0, known, differing),
        Camera("unknown", recordings=2, failed=2, error="no recording was calibrated"),
        Camera("half", "cameras/half", 3, 0, calibration(vignette=False)),
    ]
    rows = [Row("r1", "good", "done"), Row("r2", "unknown", "failed", error="torn", attempts=2)]
    parser = Order()
    parser.feed(page(cameras, rows))
    assert parser.headings == [
        "Failed: 1",
        "Contradicting the others of their camera: 1",
        "Cameras",
        "unknown",
        "split",
        "half",
        "good",
    ]
    assert "svg" in parser.tags


def test_names_are_text_and_never_markup():
    evil = "<script>alert(1)</script>\"'"
    text = page([Camera(evil, error=evil)], [Row(evil, evil, "failed", error=evil)])
    parser = Order()
    parser.feed(text)
    assert "script" not in parser.tags
    assert "default-src 'none'" in text


@given(st.text(min_size=1))
def test_folders_of_cameras_stay_inside_and_apart(name):
    folder = folder_name(name)
    assert folder not in ("", ".", "..")
    assert not set(folder) & set("/\\\0:")
    assert not folder.startswith(".")
    assert len(folder) < 80
    other = folder_name(name + "x")
    assert other.casefold() != folder.casefold() or other != folder
