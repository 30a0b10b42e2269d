"""Every module that reads files has its parser tested with damaged input."""

from __future__ import annotations

import ast
from pathlib import Path

import test_damaged_input

import ospc

READING = {
    *("read_bytes", "read_text", "loads", "frombuffer", "imdecode", "imread", "loadmat", "json_object", "read_xml"),
    "schema_of",
    *("ZipFile", "VideoCapture", "DictReader", "reader", "read_table", "process_file", "FileStorage", "ParserCreate"),
    *("open", "beginning", "open_heif", "fromfile", "genfromtxt", "loadtxt"),
}
"""Names of functions that read or parse the content of a file."""

OURS = "only what this program wrote, or what is part of it"
SAFE = "only passes bytes on, or refuses what others could not take"

PARSERS = {
    "batch/manifest.py": ["table of a batch"],
    "batch/run.py": "one word of its own batch.json, by json_object",
    "cli/interruption.py": "only the null device, to write to",
    "cli/studies.py": "the names of files of its own, by json_object",
    "correction/folder.py": "one word of its own correction.json, by json_object",
    "evaluation/trajectory.py": ["trajectory"],
    "formats/dso.py": ["pcalib.txt"],
    "formats/files.py": SAFE,
    "formats/hugin.py": ["hugin .pto"],
    "formats/lens_profiles.py": ["Adobe .lcp", "lensfun .xml"],
    "formats/opencv.py": ["OpenCV .yml"],
    "formats/image_files.py": ["vignette.png"],
    "formats/rules_camera.py": ["validate camera.txt"],
    "formats/rules_pcalib.py": ["pcalib.txt", "validate pcalib.txt"],
    "formats/rules_times.py": ["validate times.txt"],
    "formats/validation.py": ["validate times.txt", "validate vignette.png", "validate camera.txt"],
    "report/output_folder.py": "one word of its own calibration.json, by json_object",
    "photometry/calibration.py": ["calibration.json", "calibration.json to start from"],
    "photometry/vignette.py": ["vignette map"],
    "recording/bags/bag.py": ["ROS 1 bag", "ROS 2 bag, sqlite3"],
    "recording/bags/carriers.py": ["exposure message"],
    "recording/bags/container.py": ["ROS 1 bag", "ROS 2 bag, sqlite3"],
    "recording/bags/image_messages.py": ["image message"],
    "recording/bags/mcap_file.py": ["ROS 2 bag, mcap", "recording in mcap"],
    "recording/exif_photos.py": ["EXIF"],
    "recording/image_formats.py": ["EXIF", "HEIC photograph", "raw photograph"],
    "recording/list_columns.py": ["exposures.csv"],
    "recording/list_search.py": "one word of own calibration.json and correction.json, by schema_of",
    "recording/table_text.py": ["times.txt", "image_list.txt"],
    "recording/image_source.py": ["images.zip", "image file"],
    "recording/live/drivers.py": "a camera, no file",
    "recording/derived.py": ["mask", "region"],
    "recording/video.py": ["video"],
    "recording/writing/conversion.py": ["camera.txt"],
    "recording/writing/images.py": OURS,
    "research/accuracy/charts.py": "a data set that its user names as the truth",
    "research/accuracy/design.py": "a data set that its user names as the truth",
    "research/experiments/sources.py": ["exposures of a program"],
    "research/odometry/direct.py": "the truth of a simulation",
    "research/odometry/inputs.py": SAFE,
    "research/odometry/program.py": "what a program said that its user runs",
    "research/speed/measuring.py": OURS,
    "research/speed/reel.py": OURS,
    "research/runner.py": OURS,
    "simulation/texture.py": OURS,
    "state/container.py": ["state.ospc", "values of a state", "arrays of a state", "result of a batch"],
    **dict.fromkeys(
        (
            "system/atomic.py",
            "cli/rerun_stream.py",
            "system/folders.py",
            "live/page/server.py",
            "report/drawing.py",
            "report/html.py",
        ),
        OURS,
    ),
}
"""The tested parsers of every module that reads files, or the reason why it needs no test."""


def test_every_module_that_reads_files_has_a_parser_that_is_tried():
    sources = Path(ospc.__file__).parent
    found = set()
    for path in sources.rglob("*.py"):
        calls = (node.func for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Call))
        if READING & {call.attr if isinstance(call, ast.Attribute) else getattr(call, "id", "") for call in calls}:
            found.add(path.relative_to(sources).as_posix())
    assert found - PASSING_ON == set(PARSERS)


PASSING_ON = {
    *(f"cli/{name}.py" for name in ("calibrate", "check", "convert", "live", "main", "report", "simulate")),
    *("formats/opening.py", "pooling/prior_calibration.py", "recording/kinds.py"),
    "research/faults/greys.py",
}
"""Modules that only call other readers, read files they wrote themselves, or write to the null device."""


def test_the_parsers_named_are_those_that_are_tried():
    named = {name for names in PARSERS.values() if isinstance(names, list) for name in names}
    messages = {"image message", "image message of ROS 1", "description of messages"}
    assert named | messages == set(test_damaged_input.NAMES)
