"""Videos as captures: which frames are taken, what masks hide, and what a rainy video ends in."""

import json
import math
import struct
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest
from captures import capture, flower_walk, rained_on

from hydroviews.captures.video import capture as video_capture
from hydroviews.captures.video import frames as frames_module
from hydroviews.captures.video.capture import capture_video
from hydroviews.captures.video.frames import FrameChoice, sharpness, take_frames
from hydroviews.captures.video.user_masks import fill, put_masks
from hydroviews.dataset.build import build
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.read import read_scene
from hydroviews.rain.streaks.recipe import StreakPattern, composite, streak_layer
from hydroviews.scene.images import read_image, resize_area, to_uint8, without_streaks, write_png
from hydroviews.scene.masks import read_ignored
from hydroviews.scene.seeds import generator


def picture(seed: int, width: int = 64, height: int = 48) -> np.ndarray:
    """A coarse random texture, uint8 [H, W, 3]."""
    coarse = np.random.default_rng(seed).integers(30, 220, (6, 8, 3), np.uint8)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_NEAREST)


def write_video(path: Path, pictures, rate: float = 10, codec: str = "FFV1") -> Path:
    """Losslessly, unless another codec is asked for; a number stands for so many textures."""
    pictures = [picture(i) for i in range(pictures)] if isinstance(pictures, int) else pictures
    height, width = pictures[0].shape[:2]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), rate, (width, height))
    for image in pictures:
        video.write(np.ascontiguousarray(image[..., ::-1]))
    video.release()
    return path


def taken(out: Path) -> list[dict]:
    return json.loads((out / "frames.json").read_text())["frames"]


def stored(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((out / "images").iterdir())}


def times(out: Path) -> dict[str, float]:
    return {frame["name"]: frame["time"] for frame in taken(out)}


@pytest.fixture
def video(tmp_path):
    """5 s at 10 frames a second; in every second the third frame after the full one is the only sharp one."""
    pictures = [picture(i) if i % 10 == 2 else cv2.blur(picture(i), (9, 9)) for i in range(50)]
    return write_video(tmp_path / "walk.mkv", pictures)


@pytest.fixture
def out(video, tmp_path):
    """A folder with the video's five frames."""
    assert take_frames(video, tmp_path / "out", FrameChoice()) == []
    return tmp_path / "out"


def test_the_sharpest_frame_near_each_second_is_taken(video, out):
    frames = taken(out)
    assert [frame["instant"] for frame in frames] == [0, 1, 2, 3, 4]
    assert [frame["time"] for frame in frames] == pytest.approx([0.2, 1.2, 2.2, 3.2, 4.2])
    for i, frame in enumerate(frames):
        assert np.array_equal(to_uint8(read_image(out / "images" / frame["name"])), picture(10 * i + 2))
    facts = json.loads((out / "video.json").read_text())
    assert (facts["bytes"], facts["rate"]) == (video.stat().st_size, 1.0)


def test_other_rates_take_no_frame_twice(video, tmp_path):
    take_frames(video, tmp_path / "out", FrameChoice(rate=4))
    instants = list(times(tmp_path / "out").values())
    assert len(instants) == 20
    assert instants == sorted(set(instants))
    notes = take_frames(video, tmp_path / "fast", FrameChoice(rate=25))
    assert len(taken(tmp_path / "fast")) < 125
    assert "instants have no frame near them" in notes[0]


@pytest.mark.parametrize(("long_side", "shape"), [(32, (24, 32, 3)), (999, (48, 64, 3))])
def test_frames_can_be_shrunk_but_not_enlarged(video, tmp_path, long_side, shape):
    take_frames(video, tmp_path / "out", FrameChoice(long_side=long_side))
    assert read_image(tmp_path / "out/images/frame-00000.png").shape == shape


def test_sharpness_sees_blur_through_rain():
    photograph = resize_area(read_image(next((capture("llff_flower") / "images").iterdir())), 640, 480)
    kernel = np.full((1, 5), 0.2, np.float32)
    for turned in (kernel, kernel.T):
        values = []
        for image, n in ((photograph, 100), (cv2.filter2D(photograph, -1, turned), 140)):
            pattern = StreakPattern(n=n, length=30, angle=85.0, width=3)
            rainy = composite(image, streak_layer(pattern, 640, 480, generator(n, "rain")), 0.8)
            values.append(sharpness(to_uint8(rainy)))
        assert values[0] > 1.1 * values[1]


def test_an_interrupted_call_goes_on_and_lost_frames_come_back(video, out, tmp_path, monkeypatch):
    begun, written = tmp_path / "begun", []

    def interrupted(path, image):
        if len(written) == 3:
            raise KeyboardInterrupt
        written.append(path)
        write_png(path, image)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(frames_module, "write_png", interrupted)
        take_frames(video, begun, FrameChoice())
    assert len(stored(begun)) == 3
    assert not (begun / "frames.json").exists()
    for _ in range(2):
        take_frames(video, begun, FrameChoice())
        assert stored(begun) == stored(out)
        (begun / "images/frame-00002.png").unlink()


def test_other_settings_and_another_video_are_refused(video, out, tmp_path):
    with pytest.raises(InputError, match=r"taken otherwise\n.*rate 1"):
        take_frames(video, out, FrameChoice(rate=2))
    with pytest.raises(InputError, match=r"another video[\s\S]*sha256"):
        take_frames(write_video(tmp_path / "other.mkv", 40), out, FrameChoice())
    take_frames(video.rename(tmp_path / "renamed.mkv"), out, FrameChoice())


BAD_RATES = [{"rate": rate} for rate in (0, -1, float("nan"), float("inf"))]


@pytest.mark.parametrize("settings", [*BAD_RATES, {"long_side": 0}, {"long_side": 5}])
def test_choices_that_are_none(settings):
    with pytest.raises(InputError, match="--"):
        FrameChoice(**settings)


def test_a_short_video_says_which_rate_to_try(tmp_path):
    short = write_video(tmp_path / "short.mkv", 20)
    with pytest.raises(InputError, match=r"too short at a rate of 1 a second\n.*2\.0 s[\s\S]*--rate 10\.0"):
        take_frames(short, tmp_path / "out", FrameChoice())
    take_frames(short, tmp_path / "fast", FrameChoice(rate=10))
    assert len(taken(tmp_path / "fast")) == 20
    take_frames(write_video(tmp_path / "enough.mkv", 29), tmp_path / "enough", FrameChoice())
    assert len(taken(tmp_path / "enough")) == 3  # at 0, 1 and 2 of its 2.9 seconds


def test_a_damaged_video_gives_what_can_be_read_and_is_not_called_short(tmp_path):
    whole = write_video(tmp_path / "a.avi", [picture(i, 160, 120) for i in range(100)], codec="MJPG").read_bytes()
    cut, noisy, kept = tmp_path / "cut.avi", tmp_path / "noisy.avi", len(whole) // 20
    cut.write_bytes(whole[: len(whole) * 6 // 10])
    notes = take_frames(cut, tmp_path / "out", FrameChoice())
    assert "cut.avi is cut short" in notes[0]
    assert 5 <= len(taken(tmp_path / "out")) <= 7
    assert take_frames(cut, tmp_path / "out", FrameChoice()) == notes  # told again
    noisy.write_bytes(whole[:kept] + np.random.default_rng(0).bytes(len(whole) - 2 * kept) + whole[-kept:])
    with pytest.raises(InputError, match=r"noisy\.avi: damaged or trimmed after 0\.\d s\n.*\d of its 100 frames"):
        take_frames(noisy, tmp_path / "none", FrameChoice())


def trimmed(path: Path, frames: int) -> Path:
    """The first half of an MP4 film, as telephones trim it: all frames stay, and an edit list says which are shown."""
    content = bytearray(write_video(path, frames, codec="mp4v").read_bytes())
    duration = content.index(b"elst") + 12  # after type, version and number of entries
    struct.pack_into(">I", content, duration, struct.unpack_from(">I", content, duration)[0] // 2)
    path.write_bytes(content)
    return path


def test_a_trimmed_video_is_not_called_damaged_alone(tmp_path):
    notes = take_frames(trimmed(tmp_path / "half.mp4", 60), tmp_path / "out", FrameChoice())
    assert notes == ["half.mp4 is cut short or was trimmed: 30 of its 60 frames could be read"]
    with pytest.raises(InputError, match=r"damaged or trimmed after 2\.0 s[\s\S]*if it was trimmed.*--rate 10\.0"):
        take_frames(trimmed(tmp_path / "quarter.mp4", 40), tmp_path / "short", FrameChoice())


def test_capture_json_says_whether_views_are_clean_and_what_people_add_stays(video, tmp_path):
    out, path = tmp_path / "out", tmp_path / "out" / "capture.json"
    capture_video(video, out, FrameChoice(), frames_only=True)
    made = read_json(path)
    write_json(path, {**made, "metres_per_unit": 0.5, "rain": "unknown"})
    capture_video(video, out, FrameChoice(), frames_only=True)
    assert read_json(path) == {**made, "metres_per_unit": 0.5}
    capture_video(video, tmp_path / "dry", FrameChoice(), dry=True, frames_only=True)
    assert read_json(tmp_path / "dry" / "capture.json")["rain"] == "none"
    with pytest.raises(InputError, match="nothing to fill in"):
        capture_video(video, tmp_path / "dry", FrameChoice(), inpaint=True)


def test_frames_stand_upright(tmp_path):
    """The header of a video from a telephone held upright: turn by 90 degrees when shown."""
    film = write_video(tmp_path / "film.mp4", [picture(3)] * 40, codec="mp4v")
    content = bytearray(film.read_bytes())
    matrix = content.index(b"tkhd") + 4 + 40
    struct.pack_into(">9i", content, matrix, 0, 1 << 16, 0, -(1 << 16), 0, 0, 48 << 16, 0, 1 << 30)
    film.write_bytes(content)
    take_frames(film, tmp_path / "out", FrameChoice())
    upright = read_image(tmp_path / "out/images/frame-00001.png")
    assert upright.shape == (64, 48, 3)
    assert np.abs(upright - np.rot90(picture(3), -1) / 255).mean() < 0.05


def masks_of(out: Path) -> dict[str, np.ndarray]:
    return {path.name[:-4]: read_ignored(path) for path in sorted((out / "masks").iterdir())}


@pytest.fixture
def corner():
    hidden = np.zeros((48, 64), bool)
    hidden[30:, 40:] = True
    return hidden


def white(hidden):
    return np.where(hidden[..., None], np.uint8(255), np.uint8(0)).repeat(3, axis=2)


def hide(masks: Path, out: Path, inpaint: bool = False) -> list[str]:
    return put_masks(masks, out, times(out), inpaint=inpaint)


def test_one_mask_for_all_frames_hides_in_white(out, tmp_path, corner):
    write_png(tmp_path / "corner.png", white(corner.repeat(2, 0).repeat(2, 1)))  # of twice the size
    before = stored(out)
    assert hide(tmp_path / "corner.png", out) == []
    found = masks_of(out)
    assert found.keys() == before.keys()
    assert all(np.array_equal(ignored, corner) for ignored in found.values())
    assert stored(out) == before
    with pytest.raises(InputError, match="other masks"):
        hide(tmp_path / "corner.png", out, inpaint=True)


def test_masks_named_like_frames(out, tmp_path, corner):
    write_png(tmp_path / "drawn" / "frame-00001.png", white(corner))
    assert "4 of 5 frames have no mask" in hide(tmp_path / "drawn", out)[0]
    for name, ignored in masks_of(out).items():
        assert np.array_equal(ignored, corner if name == "frame-00001.png" else np.zeros_like(corner))


def test_masks_the_other_way_round_are_told(out, tmp_path, corner):
    write_png(tmp_path / "inverted.png", white(~corner))
    (note,) = hide(tmp_path / "inverted.png", out)
    assert "86% of the pixels are hidden; white is hidden: are they the other way round?" in note


@pytest.mark.parametrize(("count", "rate"), [(50, 10), (13, 2.5)], ids=["as fast", "slower"])
def test_a_video_of_masks_hides_what_is_before_and_after(out, tmp_path, count, rate):
    columns = np.eye(count, 64, dtype=bool)[:, None].repeat(48, axis=1)
    hide(write_video(tmp_path / "masks.mkv", [white(hidden) for hidden in columns], rate), out)
    found = masks_of(out)
    for name, time in times(out).items():
        around = round(rate * time, 6)
        assert np.array_equal(found[name], columns[math.floor(around)] | columns[math.ceil(around)])


def test_masks_that_cannot_be_are_refused_before_they_hide_anything(out, tmp_path, corner):
    before = stored(out)
    write_png(tmp_path / "all.png", white(corner | True))
    write_png(tmp_path / "wide.png", np.zeros((20, 64, 3), np.uint8))
    write_png(tmp_path / "other" / "people.png", white(corner))
    write_video(tmp_path / "short.mkv", [white(corner)] * 20)
    for name, message in {
        "all.png": r"all\.png: every pixel is hidden\n.*white where",
        "wide.png": r"of another shape than the frames\n.*64x20",
        "other": r"no mask is named like a frame[\s\S]*frame-00000\.png",
        "short.mkv": "shorter than the video",
        "none": "no such file or folder",
    }.items():
        with pytest.raises(InputError, match=message):
            hide(tmp_path / name, out, inpaint=True)
        assert stored(out) == before, name


def test_nothing_hidden_is_left_after_filling_in(corner):
    image = picture(0)
    noise = np.random.default_rng(0).integers(0, 256, image.shape, np.uint8)
    secret, filled = np.where(corner[..., None], noise, image), fill(image, corner)
    assert np.array_equal(fill(secret, corner), filled)
    assert np.array_equal(filled[~corner], image[~corner])
    assert not fill(secret, np.ones_like(corner)).any()


def test_frames_are_filled_in_once_and_again_where_they_were_lost(video, out, tmp_path, corner):
    write_png(tmp_path / "corner.png", white(corner))
    before = stored(out)
    hide(tmp_path / "corner.png", out, inpaint=True)
    filled = stored(out)
    assert all(filled[name] != before[name] for name in before)
    for _ in range(2):
        take_frames(video, out, FrameChoice())
        hide(tmp_path / "corner.png", out, inpaint=True)
        assert stored(out) == filled
        (out / "images/frame-00003.png").unlink()


def test_a_rainy_video_becomes_a_scene_without_clean_views(tmp_path):
    """Seven views of the flower, a second each: one sharp and rainy, the others blurred."""
    walk = [to_uint8(resize_area(rained_on(image, i), 320, 240)) for i, (_, image) in enumerate(flower_walk()[:7])]
    frames = [frame for rainy in walk for frame in (rainy, *[cv2.blur(rainy, (9, 9))] * 3)]
    video = write_video(tmp_path / "walk.mkv", frames, rate=4)
    hidden = np.zeros((240, 320), bool)
    hidden[176:, 256:] = True
    write_png(tmp_path / "hide.png", white(hidden))
    settings = {"masks": tmp_path / "hide.png", "inpaint": True}
    assert capture_video(video, tmp_path / "walk", FrameChoice(), frames_only=True, **settings) is None
    scene = capture_video(video, tmp_path / "walk", FrameChoice(), **settings)
    assert len(scene.views) >= 6
    assert scene.captured_rainy
    said = read_json(tmp_path / "walk/capture.json")
    assert (said["rain"], said["video"], said["inpainted"]) == ("captured", "walk.mkv", True)
    assert 0.5 < scene.views[0].ignored().sum() / hidden.sum() < 1.5
    assert len(scene.points) > 100
    assert all(np.isfinite(view.camera.project(scene.points.positions)[0]).all() for view in scene.views)
    with pytest.raises(InputError, match="begun with masks"):
        capture_video(video, tmp_path / "walk", FrameChoice())

    folder = build(scene, tmp_path / "data", patterns=[], long_side=100)
    opened = open_variant(folder, CAPTURED)
    assert opened.captured_rainy
    assert len(opened.train_views) + len(opened.test_views) == len(scene.views)
    assert opened.views[0].ignored().shape == opened.views[0].image().shape[:2]
    assert verify(tmp_path / "data") == []
    with pytest.raises(InputError, match="taken in rain, there are no clean views"):
        open_clean(folder)
    assert read_scene(folder / CAPTURED).split == scene.split


@pytest.mark.parametrize(("given", "used"), [({}, "auto True"), ({"features": "sift", "dry": True}, "sift False")])
def test_cameras_are_estimated_with_the_features_that_are_asked_for(tmp_path, monkeypatch, given, used):
    def estimate(images, out, **options):
        raise InputError(f"{options['features']} {options['rainy']}")

    monkeypatch.setattr(video_capture, "estimate_poses", estimate)
    with pytest.raises(InputError, match=used):
        capture_video(write_video(tmp_path / "walk.mkv", 16, rate=4), tmp_path / "out", FrameChoice(), **given)


@pytest.mark.parametrize("changed", [{"dry": True}, {"masks": True}, {"masks": True, "inpaint": True}])
def test_a_refused_command_changes_nothing(tmp_path, monkeypatch, changed):
    """Rainy frames became clean ones, or were filled in."""

    def estimate(images, out, rainy, masks, **options):
        write_json(out / "poses.json", {"rainy": rainy or None, "masks": masks and "digest"})
        raise InputError("interrupted")

    monkeypatch.setattr(video_capture, "estimate_poses", estimate)
    video, out = write_video(tmp_path / "walk.mkv", 16, rate=4), tmp_path / "walk"
    with pytest.raises(InputError, match="interrupted"):
        capture_video(video, out, FrameChoice())
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    write_png(tmp_path / "hide.png", white(np.ones((48, 64), bool)))
    options = changed | ({"masks": tmp_path / "hide.png"} if "masks" in changed else {})
    with pytest.raises(InputError, match=r"cameras of these frames were begun (in rain|without masks)"):
        capture_video(video, out, FrameChoice(), **options)
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    with pytest.raises(InputError, match="interrupted"):  # the same command goes on
        capture_video(video, out, FrameChoice())


def test_too_few_registered_frames_say_what_to_do(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (16, 48, 64, 3), np.uint8)
    video = write_video(tmp_path / "noise.mkv", noise, rate=4)
    with pytest.raises(InputError, match=r"only 0 of 4 photographs could be registered[\s\S]*--rate 2[\s\S]*--masks"):
        capture_video(video, tmp_path / "out", FrameChoice())


def test_copies_for_features_lose_streaks_and_keep_the_rest():
    grey = np.full((320, 480), 90, np.uint8)
    grey[100:200, 100:200] = 200  # part of the scene
    rainy = grey.copy()
    for x in range(10, 480, 30):
        rainy[20:60, x : x + 3], rainy[220:300, x : x + 4] = 250, 180
    assert np.array_equal(without_streaks(rainy), grey)
    assert np.array_equal(without_streaks(np.dstack([rainy, grey, rainy])), np.dstack([grey] * 3))
    large = np.full((320, 1920), 90, np.uint8)
    large[:, 700:712] = 250  # as wide, for a picture of that size
    assert (without_streaks(large) == 90).all()
    assert without_streaks(np.full((2, 3), 7, np.uint8)).tolist() == [[7] * 3] * 2


NO_FILMS = {
    "none.mp4": (None, "no such file"),
    "text.mp4": (b"not a video " * 100, "cannot be read as a video"),
    "empty.avi": (b"", "cannot be read as a video"),
    "unreadable.heic": (b"what Pillow cannot read", "a picture, not a film"),
    **{f"a.{suffix}": (suffix, "a picture, not a film") for suffix in ("png", "jpg", "webp", "heic")},
}


@pytest.mark.parametrize("name", NO_FILMS)
def test_what_is_no_film_is_told(tmp_path, capfd, name):
    content, message = NO_FILMS[name]
    if isinstance(content, str):
        PIL.Image.fromarray(picture(0)).save(tmp_path / name, "png" if content == "heic" else None)
    elif content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: {message}"):
        take_frames(tmp_path / name, tmp_path / "out", FrameChoice())
    assert not (tmp_path / "out").exists()
    assert "WARN" not in capfd.readouterr().err  # of OpenCV
    with pytest.raises(InputError, match=r"a folder, not a film\n.*hydroviews poses"):
        take_frames(tmp_path, tmp_path / "out", FrameChoice())
