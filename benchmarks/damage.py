"""Damage files below their checksums and syntax: values, tokens, archive entries, PNG chunks."""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from copy import deepcopy
from hashlib import sha256
from random import Random

VALUES: tuple[object, ...] = (
    -1, 0, 1, 2**31, 2**62, 10**400, 1e300, -1e300, 1e-300, 0.5,
    None, True, "nan", "x\0\ud800", [], {}, [1, 2], [[]],
)  # fmt: skip
"""Replacements for values in JSON documents."""

TOKENS = [
    b"nan", b"-inf", b"0", b"-0", b"-1", b"1e400", b"1e-320", b"9" * 400, b"4294967296", b"0x10", b"1_0", b"1,5", b"",
]  # fmt: skip
"""Replacements for numbers and words in texts, in addition to the parser's own."""

INTEGERS = [b"\xff" * 4, b"\xff" * 8, b"\0" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\x01\0\0\0", b"\0\x10\0\0"]
"""Replacements for numbers in binary files, such as sizes and offsets."""

_PNG = b"\x89PNG\r\n\x1a\n"
_TOKEN = re.compile(rb"[-+.\w]+")
_CHECKSUM_BYTES = 64


def damaged(data: bytes, words: list[bytes], random: Random) -> bytes:
    """Return a file with a few of its parts changed, keeping its structure if it has one."""
    if data.startswith(_PNG) and random.random() < 0.7:
        return _png(data, words, random)
    if data.startswith(b"PK\x03\x04") and random.random() < 0.7:
        return _archive(data, words, random)
    if data.lstrip()[:1] in (b"{", b"[") and random.random() < 0.8:
        return _document(data, random)
    if b"\0" not in data[:4096] and random.random() < 0.8:
        return _text(data, words, random)
    return _bytes(data, words, random)


def _document(data: bytes, random: Random) -> bytes:
    """Replace, remove or repeat a few values, lists or objects of a JSON document."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return _text(data, [], random)
    for _ in range(random.randint(1, 3)):
        inside = content
        while isinstance(inside, dict | list) and inside:
            key = random.choice(list(inside) if isinstance(inside, dict) else range(len(inside)))
            if not isinstance(inside[key], dict | list) or not inside[key] or random.random() < 0.1:
                break
            inside = inside[key]
        if not (isinstance(inside, dict | list) and inside):
            break
        if random.random() < 0.8:
            inside[key] = deepcopy(random.choice(VALUES))
        elif isinstance(inside, list) and random.random() < 0.5:
            inside.append(deepcopy(inside[key]))
        else:
            del inside[key]
    return json.dumps(content).encode()


def _text(data: bytes, words: list[bytes], random: Random) -> bytes:
    """Replace a few numbers or words, or repeat, remove or exchange lines."""
    lines = data.splitlines(keepends=True) or [b""]
    for _ in range(random.randint(1, 4)):
        index, other = random.randrange(len(lines)), random.randrange(len(lines))
        token, another = _token(lines[index], random), _token(lines[index], random)
        how = random.random()
        if how < 0.7 and token and another:
            new = random.choice(TOKENS + words) if random.random() < 0.8 else another.group()
            lines[index] = lines[index][: token.start()] + new + lines[index][token.end() :]
        elif how < 0.8:
            lines.insert(other, lines[index])
        elif how < 0.9:
            lines[index], lines[other] = lines[other], lines[index]
        elif len(lines) > 1:
            del lines[index]
    return b"".join(lines)


def _token(line: bytes, random: Random) -> re.Match[bytes] | None:
    """Return a number or word after a random position, or else the first; lines may be too long to find all."""
    return _TOKEN.search(line, random.randrange(len(line) + 1)) or _TOKEN.search(line)


def _png(data: bytes, words: list[bytes], random: Random) -> bytes:
    """Damage, repeat or remove one chunk of a PNG file, and correct its checksum."""
    chunks: list[tuple[bytes, bytes]] = []
    begin = len(_PNG)
    while begin + 12 <= len(data) and len(chunks) < 100:
        (length,) = struct.unpack_from(">I", data, begin)
        chunks.append((data[begin + 4 : begin + 8], data[begin + 8 : begin + 8 + length]))
        begin += 12 + length
    if not chunks:
        return _bytes(data, words, random)
    index = random.randrange(len(chunks))
    kind, content = chunks[index]
    how = random.random()
    if how < 0.8 and content:
        recompressed = kind == b"IDAT" and random.random() < 0.5
        chunks[index] = (kind, (_recompressed if recompressed else _bytes)(content, words, random))
    elif how < 0.9:
        chunks.insert(random.randrange(len(chunks)), (kind, content))
    else:
        del chunks[index]
    sealed = (struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c)) for k, c in chunks)
    return _PNG + b"".join(sealed)


def _recompressed(content: bytes, words: list[bytes], random: Random) -> bytes:
    unpacker = zlib.decompressobj()
    try:
        plain = unpacker.decompress(content, 2**20)
    except zlib.error:
        return _bytes(content, words, random)
    return zlib.compress(_bytes(plain, words, random), 1)


def _archive(data: bytes, words: list[bytes], random: Random) -> bytes:
    """Damage, repeat, rename or remove one entry of a zip archive, and renew the checksum of our own states."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            sealed = len(archive.comment) == _CHECKSUM_BYTES
            entries = [(entry.filename, archive.open(entry).read(2**22)) for entry in archive.infolist()[:100]]
    except Exception:  # zipfile raises many errors for an archive broken by an earlier mutation
        return _bytes(data, words, random)
    if not entries:
        return _bytes(data, words, random)
    index = random.randrange(len(entries))
    name, content = entries[index]
    how = random.random()
    if how < 0.75:
        entries[index] = (name, damaged(content, words, random))
    elif how < 0.85:
        entries[index] = (random.choice(["../a.png", "/a.png", "a" * 300, name + "/", "\ud800", "b.png"]), content)
    elif how < 0.95:
        entries.insert(random.randrange(len(entries) + 1), (name, content))
    else:
        del entries[index]
    packed = io.BytesIO()
    method = zipfile.ZIP_DEFLATED if random.random() < 0.9 else zipfile.ZIP_STORED
    level = random.choice([0, 0, 0, 1])  # compression takes most of the time
    with zipfile.ZipFile(packed, "w", method, compresslevel=level) as archive:
        for entry_name, entry_content in entries:
            entry = zipfile.ZipInfo(entry_name.encode("utf-8", "replace").decode())
            entry.compress_type = method
            with archive.open(entry, "w") as stream:
                stream.write(entry_content)
        archive.comment = bytes(_CHECKSUM_BYTES) if sealed else b""
    result = packed.getvalue()
    if sealed:
        result = result[:-_CHECKSUM_BYTES] + sha256(result[:-_CHECKSUM_BYTES]).hexdigest().encode()
    return result


def _bytes(data: bytes, words: list[bytes], random: Random) -> bytes:
    """Change, repeat or remove a few bytes, or cut the file off."""
    result = bytearray(data)
    edits: list[Callable[[int, bytes, int], None]] = [
        lambda place, piece, length: result.__setitem__(slice(place, place + len(piece)), piece),
        lambda place, piece, length: result.__setitem__(slice(place, place), piece),
        lambda place, piece, length: result.__delitem__(slice(place, place + length)),
        lambda place, piece, length: result.__setitem__(slice(place, place), result[place : place + length]),
    ]
    for _ in range(random.randint(1, 6)):
        piece = random.choice(INTEGERS + words) if random.random() < 0.5 else random.randbytes(random.randint(1, 4))
        random.choice(edits)(int(random.random() * len(result)), piece, random.randint(1, 40))
    if random.random() < 0.1:
        del result[int(random.random() * len(result)) :]
    return bytes(result)
