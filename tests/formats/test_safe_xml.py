"""Untrusted XML does no harm."""

from __future__ import annotations

import pytest

from ospc.errors import FormatError
from ospc.formats.lens_profiles import read_lcp, read_xml

BOMB = (
    '<!DOCTYPE a [<!ENTITY x "xxxxxxxxxx"><!ENTITY y "&x;&x;&x;&x;&x;&x;&x;&x;&x;&x;">]><a>&y;&y;&y;&y;&y;&y;&y;</a>'
)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (BOMB, "DOCTYPE"),
        ('<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a>&x;</a>', "DOCTYPE"),
        ('<!DOCTYPE a [<!ENTITY % x SYSTEM "http://127.0.0.1/x"> %x;]><a/>', "DOCTYPE"),
        ("<a>&x;</a>", "not readable"),
        ('<!DOCTYPE a SYSTEM "http://127.0.0.1:9/a.dtd"><a>&x;</a>', "not readable"),
        ("<a><b></a>", "not readable"),
        ("", "not readable"),
        ('<?xml version="1.0" encoding="nonsense"?><a/>', "not readable"),
    ],
)
def test_dangerous_and_broken_files_are_refused(tmp_path, text, reason):
    place = tmp_path / "a.xml"
    place.write_text(text)
    with pytest.raises(FormatError, match=reason):
        read_xml(place)


def test_external_document_type_is_passed_over_and_not_fetched(tmp_path):
    place = tmp_path / "a.xml"
    place.write_text('<!DOCTYPE a SYSTEM "http://127.0.0.1:9/a.dtd">\n<a><b>text</b></a>')
    assert read_xml(place).findtext("b") == "text"


def test_entities_are_also_refused_in_utf_16(tmp_path):
    place = tmp_path / "a.xml"
    place.write_text(BOMB, encoding="utf-16")
    with pytest.raises(FormatError, match="DOCTYPE"):
        read_xml(place)


def test_deep_nesting_is_no_problem(tmp_path):
    place = tmp_path / "a.xml"
    place.write_text("<a>" * 100_000 + "<b>text</b>" + "</a>" * 100_000)
    assert next(read_xml(place).iter("b")).text == "text"
    with pytest.raises(FormatError, match="no vignette model"):
        read_lcp(place)
