"""The table and page of a batch are complete, unambiguous and safe to open."""

from __future__ import annotations

import csv
from dataclasses import asdict
from html import unescape
from html.parser import HTMLParser

from hypothesis import given
from hypothesis import strategies as st

from calibrations import calibration
from ospc.batch.cameras import Camera, folder_name, page
from ospc.batch.store import SCHEMA, Row, write_csv
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
FORMULAS = ("=", "+", "-", "@", "\t", "\r")


@given(rows=st.lists(ROWS, max_size=4))
def test_the_csv_table_holds_every_value_as_text(rows, tmp_path_factory):
    with write_csv(rows, tmp_path_factory.mktemp("table") / "batch.csv").open(newline="") as stream:
        found = list(csv.DictReader(stream))
    for values, row in zip(found, rows, strict=True):
        assert values.pop("schema") == SCHEMA
        for name, value in asdict(row).items():
            quoted = isinstance(value, str) and value.startswith(FORMULAS)
            assert values[name] == ("" if value is None else "'" * quoted + str(value))


class Order(HTMLParser):
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
        "Contradicting other recordings of their camera: 1",
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
    assert "default-src 'none'" in unescape(text)


@given(st.text(min_size=1))
def test_folders_of_cameras_stay_inside_and_apart(name):
    folder = folder_name(name)
    assert folder not in ("", ".", "..")
    assert not set(folder) & set("/\\\0:")
    assert not folder.startswith(".")
    assert len(folder) < 80
    assert folder_name(name + "x") != folder
