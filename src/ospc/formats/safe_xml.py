"""Untrusted XML: no entities, bounded size and depth, nothing fetched."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from ospc.errors import FormatError
from ospc.formats.files import read_bytes

_DEEPEST = 64
"""Levels of nesting; lens profiles have about ten."""

_LARGEST = 2**24
"""Bytes; the largest lens profiles have a few megabytes."""


def read_xml(path: str | Path) -> ElementTree.Element:
    """Return the root of an XML file; FormatError if it cannot be read, is not XML, or is nested too deeply.

    A document type that only names an external definition, as in lensfun's files, is ignored and not fetched. One
    with its own definitions is refused, because entities can expand without bound.
    """
    content = read_bytes(path, _LARGEST)
    tree = ElementTree.TreeBuilder()
    depth = 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise FormatError(f"{path}: elements are nested more than {_DEEPEST} deep")
        tree.start(name, attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        tree.end(name)

    def doctype(_name: str, _system: str | None, _public: str | None, internal: int) -> None:
        if internal:
            raise FormatError(f"{path}: defines its own document type, which is not accepted; remove <!DOCTYPE>")

    def entity(*_arguments: Any) -> None:
        raise FormatError(f"{path}: defines or uses entities, which is not accepted")

    parser = expat.ParserCreate(namespace_separator="}")
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = begin, end, tree.data
    parser.StartDoctypeDeclHandler, parser.EntityDeclHandler, parser.SkippedEntityHandler = doctype, entity, entity
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise FormatError(f"{path}: not readable as XML ({error})") from None
    return tree.close()


def write_xml(root: ElementTree.Element) -> str:
    """Return an element as the text of an XML file, indented."""
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=False) + "\n"


def local_name(tag: str) -> str:
    """Return a tag or attribute name without its name space."""
    return tag.rsplit("}", 1)[-1]
