"""Which topics of a bag are read if the user does not say."""

from __future__ import annotations

from collections.abc import Sequence

from ospc.errors import ExposureError, RecordingError, escaped, listed, quoted
from ospc.recording.bags.bag import Bag
from ospc.recording.bags.carriers import candidates
from ospc.recording.bags.container import Topic
from ospc.recording.bags.image_messages import IMAGE_TYPES, RAW
from ospc.recording.options import ReadingOptions

_NOT_PHOTOGRAPHS = ("depth", "disparity", "segmentation", "mask", "label")
"""Topics of images whose names contain one of these hold something other than grey values."""


def image_topic(bag: Bag, options: ReadingOptions) -> tuple[Topic, list[str]]:
    """Return the topic with the images, and notes about the choice; RecordingError if there is none."""
    if options.image_topic is not None:
        topic = _named(bag, options.image_topic)
        if topic.type not in IMAGE_TYPES:
            raise RecordingError(f"{bag.path}: {topic.name} has no images but {topic.type}; see --list-topics")
        return topic, []
    found = image_topics(bag)
    if not found:
        raise RecordingError(f"{bag.path}: has no topic with images; it has {_names(bag.topics)}")
    first, *others = found
    names = listed([topic.name for topic in others])
    return first, [f"{escaped(first.name)} is read; choose {names} with --image-topic"] if others else []


def image_topics(bag: Bag) -> list[Topic]:
    """Return the topics with images of cameras, one per camera, without depth; raw images before compressed ones."""
    images = [t for t in bag.topics if t.type in IMAGE_TYPES and t.messages != 0]
    grey = [t for t in images if not any(word in t.name.lower() for word in _NOT_PHOTOGRAPHS)] or images
    raw = [t for t in grey if t.type == RAW]
    bases = {t.name for t in raw}
    return raw + [t for t in grey if t.type != RAW and not any(t.name.startswith(f"{base}/") for base in bases)]


def uses(bag: Bag) -> list[tuple[Topic, str]]:
    """Return every topic with what it can be used for: ``images``, ``exposures``, or an empty text."""
    carriers = {topic.name for topic in candidates(bag.topics)}
    return [
        (topic, "images" if topic.type in IMAGE_TYPES else "exposures" if topic.name in carriers else "")
        for topic in bag.topics
    ]


def exposure_topic(bag: Bag, images: Topic, options: ReadingOptions) -> Topic:
    """Return the topic with the exposures of the images on another topic.

    ExposureError if there is none, or several with names equally similar to that of the images.
    """
    if options.exposure_topic is not None:
        return _named(bag, options.exposure_topic)
    cameras = image_topics(bag)
    carriers = (t for t in candidates(bag.topics) if t.messages != 0)
    found = [t for t in carriers if own_exposure_topic(bag, t.name, images, cameras) == t.name]
    if not found:
        raise ExposureError(
            f"{bag.path}: no topic is known to hold the exposures of {images.name}; state it with "
            f"--exposure-topic and --exposure-field; there are {_names(bag.topics)}"
        )
    shared = [_shared(t.name, images.name) for t in found]
    best = [t for t, count in zip(found, shared, strict=True) if count == max(shared)]
    if len(best) > 1:
        raise ExposureError(
            f"{bag.path}: several topics may hold the exposures of {images.name} "
            f"({listed([t.name for t in best])}); state one with --exposure-topic"
        )
    return best[0]


def own_exposure_topic(bag: Bag, stated: str, images: Topic, cameras: Sequence[Topic]) -> str | None:
    """Return the topic with the exposures of one of several cameras, when the user stated one topic for all.

    Exposures below the name of one camera, such as ``/cam0/exposure``, are those of this camera; others have them at
    the same place below their own name, otherwise None. A topic of no particular camera serves all.
    """
    shared = {camera.name: _shared(camera.name, stated) for camera in (images, *cameras)}
    owner = max(shared, key=shared.__getitem__)
    if shared[images.name] == shared[owner]:
        return stated
    differing = _shared(owner, images.name)
    parts, own = stated.strip("/").split("/"), images.name.strip("/").split("/")
    sibling = "/".join([*own[: differing + 1], *parts[differing + 1 :]])
    return next((topic.name for topic in bag.topics if topic.name.strip("/") == sibling), None)


def _shared(name: str, other: str) -> int:
    """Return how many leading parts two names of topics have in common."""
    pairs = list(zip(name.strip("/").split("/"), other.strip("/").split("/"), strict=False))
    return next((count for count, (part, other_part) in enumerate(pairs) if part != other_part), len(pairs))


def _named(bag: Bag, name: str) -> Topic:
    for topic in bag.topics:
        if topic.name.strip("/") == name.strip("/"):
            return topic
    raise RecordingError(f"{bag.path}: has no topic {quoted(name)}; it has {_names(bag.topics)}")


def _names(topics: tuple[Topic, ...]) -> str:
    return listed([f"{t.name} ({t.type})" for t in topics]) if topics else "none at all"
