"""HEIC and raw photographs, which optional libraries decode."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from image_samples import encoded, grey
from photo_samples import dng, heic

from exif_segments import exif
from ospc.correction.folder import CorrectedFolder
from ospc.correction.recording import correct_recording
from ospc.correction.settings import CorrectionSettings
from ospc.correction.source import open_source
from ospc.errors import FrameError, MissingExtraError, RecordingError
from ospc.formats.opening import Photometry
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import frame, image_source, open_recording
from ospc.recording.channel import Channel
from ospc.recording.image_source import decode_stored
from ospc.recording.options import ReadingOptions

SIZE = (96, 64)


def smooth(size: tuple[int, int] = SIZE, top: int = 255, channels: int = 3) -> np.ndarray:
    """Return gradients, which compression changes only slightly."""
    x, y = np.meshgrid(*(np.linspace(0, 1, length) for length in size))
    planes = [x, y, (x + y) / 2][:channels]
    return np.rint(top * np.stack(planes, axis=2)).astype(np.uint8 if top == 255 else np.uint16).squeeze()


class TestHeic:
    @pytest.fixture(autouse=True)
    def _library(self) -> None:
        pytest.importorskip("pillow_heif", reason="needs the extra 'heic'")

    def test_channels_are_those_of_the_image(self) -> None:
        image, data = smooth(), heic(smooth())
        assert np.abs(decode_stored(data, "a.heic", Channel.ALL).pixels.astype(int) - image).max() <= 4
        luma = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(int)
        assert np.abs(decode_stored(data, "a.HEIC", Channel.LUMINANCE).pixels - luma).max() <= 4
        assert np.abs(decode_stored(data, "a.HEIC").pixels.astype(int) - image[:, :, 1]).max() <= 4

    def test_grey_images_stay_grey(self) -> None:
        stored = decode_stored(heic(smooth(channels=1)), "a.heic")
        assert stored.channel is None
        assert np.abs(stored.pixels.astype(int) - smooth(channels=1)).max() <= 2

    @pytest.mark.parametrize("top", [65535, 9000])
    def test_ten_bits_are_kept_also_of_dark_images(self, tmp_path: Path, top: int) -> None:
        (tmp_path / "a.heic").write_bytes(heic(smooth(top=top), exif()))
        recording = open_recording(tmp_path, options=ReadingOptions(channel=Channel.GREEN))
        assert recording.max_grey == 1023
        expected = smooth(top=top)[:, :, 1].astype(int) >> 6
        assert np.abs(next(iter(recording)).image.astype(int) - expected).max() <= 8

    @pytest.mark.parametrize("orientation", range(1, 9))
    def test_images_are_on_the_axes_of_the_sensor(self, orientation: int) -> None:
        image = smooth()
        image[:20, :30] = (0, 0, 255)
        upright = {  # What a camera in this orientation stores: libheif rotates the image for display.
            1: image,
            2: image[:, ::-1],
            3: image[::-1, ::-1],
            4: image[::-1],
            5: image.transpose(1, 0, 2),
            6: np.rot90(image, -1),
            7: np.rot90(image, 2).transpose(1, 0, 2),
            8: np.rot90(image),
        }[orientation]
        import pillow_heif

        data = heic(image, orientation=orientation)
        shown = np.asarray(pillow_heif.open_heif(data, bgr_mode=True)).astype(int)
        assert np.abs(shown - upright).mean() < 1
        assert np.abs(decode_stored(data, "a.heic", Channel.ALL).pixels.astype(int) - image).mean() < 1

    def test_a_folder_is_a_recording_with_the_exposures_of_its_exif(self, tmp_path: Path) -> None:
        for i, (time, iso) in enumerate([((1, 100), 100), ((1, 50), 200)]):
            segment = exif(time, (4, 1), iso, f"2020:01:02 03:04:0{i}")
            (tmp_path / f"IMG_{i}.HEIC").write_bytes(heic(smooth(), segment))
        recording = open_recording(tmp_path)
        assert recording.kind == "exif_photos"
        assert recording.exposures_ms == pytest.approx(np.array([10, 40]) / 16)
        assert recording.stamps_s.tolist() == [0, 1]
        assert recording.size == SIZE

    def test_images_that_need_too_much_memory_are_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(frame, "MAX_DECODED_BYTES", 1000)
        with pytest.raises(FrameError, match=r"a.heic: .*96×64 pixels, which need more than"):
            decode_stored(heic(smooth()), "a.heic")

    @pytest.mark.parametrize("length", [0, 100, 500, -100])
    def test_truncated_images_are_refused(self, length: int) -> None:
        with pytest.raises(FrameError, match=r"a\.heic: the HEIC image is damaged"):
            decode_stored(heic(grey(0, SIZE))[:length], "a.heic")

    def test_a_text_file_is_no_photograph(self, tmp_path: Path) -> None:
        (tmp_path / "a.heic").write_text("hello")
        with pytest.raises(RecordingError, match=r"a\.heic: the HEIC image is damaged"):
            open_recording(tmp_path)

    def test_corrected_copies_keep_the_exif(self, tmp_path: Path) -> None:
        (tmp_path / "photos").mkdir()
        (tmp_path / "photos" / "a.heic").write_bytes(heic(smooth(), exif(model="M7")))
        corrected(tmp_path, CorrectionSettings(keep_response=True))
        assert b"M7" in (tmp_path / "out" / "images" / "a.png").read_bytes()


class TestRaw:
    @pytest.fixture(autouse=True)
    def _library(self) -> None:
        pytest.importorskip("rawpy", reason="needs the extra 'raw'")

    @pytest.mark.parametrize("pattern", ["rggb", "bggr", "grbg", "gbrg"])
    def test_values_are_linear_between_black_and_white(self, pattern: str) -> None:
        mosaic = grey(0, SIZE, np.uint16, 1100)
        stored = decode_stored(dng(mosaic, 64, 1023, pattern), "a.dng")
        expected = np.clip((mosaic.astype(float) - 64) / (1023 - 64), 0, 1) * 65535
        assert np.abs(stored.pixels - expected).max() <= 0.51
        assert stored.mosaic is not None
        assert stored.mosaic.pattern == pattern

    def test_every_colour_has_its_own_black_level(self) -> None:
        mosaic = np.tile(np.array([[50, 60], [70, 80]], np.uint16), (32, 48))
        assert not decode_stored(dng(mosaic, (50, 60, 70, 80)), "a.dng").pixels.any()

    def test_in_colour_each_block_is_a_pixel(self) -> None:
        mosaic = np.tile(np.array([[200, 400], [600, 1000]], np.uint16), (32, 48))
        stored = decode_stored(dng(mosaic, 0, 1000), "a.dng", Channel.ALL)
        assert stored.pixels.shape == (32, 48, 3)
        assert stored.pixels[0, 0] == pytest.approx(np.array([1.0, 0.5, 0.2]) * 65535, abs=1)

    def test_linear_colours_are_read(self) -> None:
        image = smooth(top=1000)
        stored = decode_stored(dng(image, 0, 1000), "a.dng", Channel.ALL)
        assert stored.channel is Channel.ALL
        assert np.abs(stored.pixels[:, :, ::-1] - image / 1000 * 65535).max() <= 0.51

    def test_a_folder_is_a_recording_of_its_green_pixels(self, tmp_path: Path) -> None:
        for i, (time, iso) in enumerate([((1, 100), 100), ((1, 50), 200)]):
            (tmp_path / f"a{i}.DNG").write_bytes(dng(grey(i, SIZE, np.uint16, 300), time=time, iso=iso))
        recording = open_recording(tmp_path)
        assert recording.kind == "exif_photos"
        assert recording.exposures_ms == pytest.approx(np.array([10, 40]) / 16, rel=1e-3)
        assert recording.size == (SIZE[0] // 2, SIZE[1] // 2)
        assert recording.max_grey == 65535  # stated by the files, although the images are dark

    def test_images_that_need_too_much_memory_are_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(frame, "MAX_DECODED_BYTES", 1000)
        with pytest.raises(FrameError, match=r"a.dng: .*96×64 pixels, which need more than"):
            decode_stored(dng(grey(0, SIZE, np.uint16)), "a.dng")

    @pytest.mark.parametrize("length", [0, 100, -1000])
    def test_truncated_images_are_refused(self, length: int) -> None:
        with pytest.raises(FrameError, match=r"a\.dng: is damaged, or from an unknown camera"):
            decode_stored(dng(grey(0, SIZE, np.uint16))[:length], "a.dng")

    def test_a_white_level_below_black_is_refused(self) -> None:
        with pytest.raises(FrameError, match=r"a\.dng: "):
            decode_stored(dng(grey(0, SIZE, np.uint16), 500, 400), "a.dng")

    def test_corrected_copies_are_in_colour(self, tmp_path: Path) -> None:
        (tmp_path / "photos").mkdir()
        mosaic = np.tile(np.array([[200, 400], [400, 800]], np.uint16), (32, 48))
        (tmp_path / "photos" / "a.dng").write_bytes(dng(mosaic, 0, 1000))
        corrected(tmp_path, CorrectionSettings(), (SIZE[0] // 2, SIZE[1] // 2))
        image = cv2.imread(str(tmp_path / "out" / "images" / "a.tiff"), cv2.IMREAD_UNCHANGED)
        assert image[16, 24] == pytest.approx([0.8, 0.4, 0.2], rel=2e-3)
        assert image[0, 0] == pytest.approx(image[16, 24] / 0.8, rel=0.02)  # the vignette at the corner


def corrected(place: Path, settings: CorrectionSettings, size: tuple[int, int] = SIZE) -> None:
    source = open_source([place / "photos"], options=ReadingOptions(channel=Channel.ALL))
    linear = Response(np.linspace(0.0, 1.0, 256))
    vignette = PolynomialVignette(size, (-0.2, 0.0, 0.0))
    photometry = Photometry(name="linear", response=linear, vignette=vignette)
    correct_recording(source, photometry, CorrectedFolder.at(place / "out", place / "photos"), settings)


@pytest.mark.parametrize(("name", "module", "extra"), [("a.heic", "pillow_heif", "heic"), ("a.CR2", "rawpy", "raw")])
class TestWithoutTheLibrary:
    @pytest.fixture(autouse=True)
    def _no_library(self, monkeypatch: pytest.MonkeyPatch, module: str) -> None:
        monkeypatch.setitem(sys.modules, module, None)

    @pytest.mark.parametrize("use", [open_recording, lambda place: open_source([place])], ids=["open", "correct"])
    def test_the_extra_is_named(self, tmp_path: Path, use: Callable[[Path], object], name: str, extra: str) -> None:
        (tmp_path / name).write_bytes(b"photo")
        with pytest.raises(MissingExtraError, match=rf"ospc\[{extra}\]"):
            use(tmp_path)

    def test_jpegs_beside_them_are_read_with_a_note(self, tmp_path: Path, name: str, extra: str) -> None:
        (tmp_path / name).write_bytes(b"photo")
        (tmp_path / "a.jpg").write_bytes(encoded(grey(0), ".jpg"))
        recording = open_recording(tmp_path, options=ReadingOptions(unknown_exposures=True))
        assert [f.name for f in recording] == ["a.jpg"]
        assert any(f"{name} left out" in note for note in recording.notes)


def test_decoding_knows_them_by_name_only() -> None:
    image = grey(0)
    np.testing.assert_array_equal(image_source.decode_grey(encoded(image), "heic"), image)
