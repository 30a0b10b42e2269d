"""Untrusted XML does no harm."""

from __future__ import annotations

import pytest

from ospc.errors import FormatError
from ospc.formats.lens_profiles import read_xml

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
        ('<!DOCTYPE a SYSTEM "http://127.0.0.1:9/a.dtd"><a>&x;</a>', "entities"),
        ("<a><b></a>", "not readable"),
        ("", "not readable"),
        ("<a>" * 100 + "</a>" * 100, "deep"),
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
