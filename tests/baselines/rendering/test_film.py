"""Films of finished runs: the frames asked for, gone on with after an interruption, playable."""

import math
import resource
from dataclasses import replace

import cv2
import numpy as np
import pytest
from finished_runs import Cloud, finished_run

from baselines.rendering.film import FilmChoice, fitted, write_film
from hydroviews.captures.video.decoding import open_video, video_frames
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from hydroviews.scene.images import read_image, write_png
from leaderboard.viewer.film import film

CHOICE = FilmChoice(seconds=0.5, fps=12, size=64)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return finished_run(tmp_path_factory.mktemp("film"))


def read_film(path) -> tuple[np.ndarray, float, str]:
    capture, frames = cv2.VideoCapture(str(path)), []
    code = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode()
    while (got := capture.read())[0]:
        frames.append(got[1][..., ::-1] / 255)
    return np.array(frames), capture.get(cv2.CAP_PROP_FPS), code


@pytest.mark.parametrize("suffix", ["mp4", "webm"])
def test_a_film_has_the_frames_asked_for_in_a_codec_that_browsers_play(run, tmp_path, suffix):
    out = tmp_path / f"film.{suffix}"
    film(run.folder, run.data.parent, out, CHOICE)
    frames, fps, code = read_film(out)
    assert frames.shape == (6, 48, 64, 3)
    assert fps == pytest.approx(12)
    assert code.lower() in ("vp09", "vp90")
    assert np.abs(frames[0] - frames[3]).mean() > 0.02  # it moves
    assert [path.name for path in tmp_path.iterdir() if path.name[0] != "."] == [out.name]


def test_an_interrupted_film_goes_on_with_the_frames_it_has(run, tmp_path, monkeypatch):
    out, rendered, render = tmp_path / "film.mp4", [], Cloud.render

    def interrupted(self, camera):
        rendered.append(camera)
        if len(rendered) == 5:
            raise KeyboardInterrupt
        return render(self, camera)

    monkeypatch.setattr(Cloud, "render", interrupted)
    with pytest.raises(KeyboardInterrupt):
        film(run.folder, run.data.parent, out, CHOICE)
    frames = sorted((tmp_path / "film-frames").glob("*.png"))
    assert len(frames) == 4
    assert not out.exists()
    with pytest.raises(InputError, match="another film"):
        film(run.folder, run.data.parent, out, replace(CHOICE, size=48))
    stamps, kept = [path.stat().st_mtime_ns for path in frames], [read_image(path) for path in frames]

    def watched(self, camera):
        rendered.append(camera)
        assert [path.stat().st_mtime_ns for path in frames] == stamps
        return render(self, camera)

    rendered.clear()
    monkeypatch.setattr(Cloud, "render", watched)
    film(run.folder, run.data.parent, out, CHOICE)
    assert len(rendered) == 2
    assert np.abs(read_film(out)[0][:4] - kept).mean() < 0.05
    assert not (tmp_path / "film-frames").exists()


def test_a_film_that_a_full_disk_cuts_short_does_not_replace_a_whole_one(tmp_path):
    noise, out = np.random.default_rng(0), tmp_path / "film.mp4"
    for index in range(12):
        write_png(tmp_path / "frames" / f"{index:05d}.png", noise.random((48, 64, 3)).astype(np.float32))
    write_bytes(out, b"of before")
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, unlimited[1]))  # bytes of a file, in place of a full disk
    try:
        with pytest.raises(InputError, match=r"film\.mp4: not written whole\n  found: [0-9] of 12 frames"):
            write_film(out, tmp_path / "frames", 12, 10)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
    assert out.read_bytes() == b"of before"


@pytest.mark.parametrize("suffix", ["mp4", "webm"])
def test_a_film_says_which_colours_it_has_and_shows_them(tmp_path, suffix):
    patches = np.array([[200, 40, 40], [40, 160, 40], [40, 60, 200], [230, 150, 120]], np.uint8)
    picture = patches.reshape(2, 2, 3).repeat(24, 0).repeat(32, 1)
    for index in range(3):
        write_png(tmp_path / "frames" / f"{index:05d}.png", picture / np.float32(255))
    out = tmp_path / f"film.{suffix}"
    write_film(out, tmp_path / "frames", 3, 10)
    with open_video(out) as video:
        frames = list(video_frames(video))
    decoded = frames[0].decoded
    tags = decoded.colorspace, decoded.color_range, decoded.color_primaries, decoded.color_trc
    assert tuple(map(int, tags)) == (1, 1, 1, 13)  # BT.709's matrix, limited range, BT.709's primaries, sRGB
    assert [frame.time for frame in frames] == pytest.approx([0, 0.1, 0.2], abs=2e-3)
    middles = frames[0].pixels[12::24, 16::32].astype(int)
    assert np.abs(middles - patches.reshape(2, 2, 3)).max() <= 3  # by BT.601's matrix it would be 15


def test_a_film_of_somebody_else_is_not_written_over(run, tmp_path):
    out = tmp_path / "film.mp4"
    out.write_bytes(b"holiday")
    with pytest.raises(InputError, match=r"film\.mp4: not written by HydroViews, and in the way"):
        film(run.folder, run.data.parent, out, CHOICE)
    assert out.read_bytes() == b"holiday"


def test_cameras_are_enlarged_to_even_sides(run):
    camera = run.clean_scene().test_views[0].camera  # 48x36
    large = fitted(camera, 801)
    assert (large.width, large.height) == (800, 600)
    assert large.fx / large.width == pytest.approx(camera.fx / camera.width)


@pytest.mark.parametrize(
    "changes",
    [{"seconds": 0.05}, {"fps": 0}, {"size": 5}, {"seconds": 1e6}, {"seconds": math.nan}, {"seconds": math.inf}],
)
def test_impossible_films_are_refused(changes):
    with pytest.raises(InputError, match="impossible"):
        FilmChoice(**{"seconds": 1.0, "fps": 10, "size": 64, **changes})
