"""The viewer: what it puts into the scene, and what choosing a view shows; and exported splat files."""

import shutil
import socket
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest
import torch
from compressed_ply import read_compressed_ply
from finished_runs import finished_run

from baselines.splatting.backends.torch_rasterizer import basis
from baselines.splatting.files.ply import read_ply
from baselines.splatting.rasterizer import render
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.metrics import psnr
from hydroviews.scene.images import read_image
from leaderboard.runs.finished_runs import find_splats, finished_runs, load_method, open_run
from leaderboard.runs.run import Run
from leaderboard.viewer import normalise
from leaderboard.viewer.comparison import compare, list_shots
from leaderboard.viewer.export import export
from leaderboard.viewer.origins import is_own, own_names, own_pages_only
from leaderboard.viewer.ports import free_port
from leaderboard.viewer.viewer import HELD_OUT, TRAINING, open_viewer


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Run:
    return finished_run(tmp_path_factory.mktemp("view"))


@pytest.fixture
def viser():
    return pytest.importorskip("viser", reason="needs the extra viewer")


@contextmanager
def viewing(run: Run):
    viewer = open_viewer(run.folder, run.data.parent, port=0)
    try:
        yield viewer
    finally:
        viewer.server.stop()


class TestComparison:
    def test_training_photographs_come_first_and_rainy_then_clean_held_out_ones(self, run):
        shots = list_shots(run)
        assert [shot.view.name for shot in shots if shot.held_out] == list(run.clean_scene().split.test)
        assert [shot.held_out for shot in shots] == [False] * 7 + [True] * 2
        assert [shot.view.path.parent.name for shot in shots] == ["images"] * 7 + ["clean"] * 2
        assert shots[-1].label == "view-08 (held out)"

    def test_psnr_is_that_of_the_written_render(self, run):
        shot = list_shots(run)[-1]
        comparison = compare(load_method(run), shot)
        written = read_image(run.folder / "renders" / f"{shot.view.name}.png")
        assert np.array_equal(comparison.render, written)
        assert comparison.score == psnr(written, read_image(shot.view.path))
        assert comparison.error.shape == comparison.photograph.shape == written.shape
        assert compare(load_method(run), list_shots(run)[0]).score is None

    def test_what_was_captured_in_rain_is_shown_and_not_scored(self, tmp_path):
        wet = finished_run(tmp_path, rainy=True)
        shots = list_shots(wet)
        assert [shot.held_out for shot in shots] == [False] * 7 + [True] * 2
        assert compare(load_method(wet), shots[-1]).score is None


class TestStage:
    def test_a_scene_far_away_is_shown_as_the_same_one_near(self, run, tmp_path):
        far = finished_run(tmp_path, shift=1e6)
        splats, places, lengths = [], [], []
        for one in (run, far):
            gaussians, cameras = find_splats(one.folder), [shot.view.camera for shot in list_shots(one)]
            normalisation = normalise.normalise_scene(cameras, gaussians)
            splats.append(normalise.normalise_splats(gaussians, cameras, normalisation))
            places.append(normalise.pose(cameras[0], normalisation)[1])
            lengths.append(normalise.frustum_length(cameras, normalisation))
        for name, value in vars(splats[0]).items():
            assert np.allclose(getattr(splats[1], name), value, atol=1e-3), name
        assert np.allclose(*places, atol=1e-5)
        assert lengths[0] == pytest.approx(lengths[1])

    def test_splats_have_the_shapes_and_colours_of_the_gaussians(self, run):
        gaussians, cameras = find_splats(run.folder), [list_shots(run)[0].view.camera]
        normalisation = normalise.normalise_scene(cameras, gaussians)
        splats = normalise.normalise_splats(gaussians, cameras, normalisation)
        assert np.median(np.linalg.norm(splats.centers, axis=1)) == pytest.approx(normalise.SIZE)
        assert np.allclose(np.sqrt(np.linalg.eigvalsh(splats.covariances)), 0.1 * normalisation.scale, rtol=1e-3)
        direction = gaussians.means[0] + gaussians.origin - cameras[0].centre
        values = basis(1, torch.from_numpy(direction / np.linalg.norm(direction))[None]).numpy()
        assert np.allclose(splats.rgbs[0], np.clip(values @ gaussians.sh[0] + 0.5, 0, 1), atol=1e-5)
        assert np.allclose(splats.opacities[:, 0], 1 / (1 + np.exp(-gaussians.opacity_logits)), atol=1e-6)

    def test_a_window_of_any_shape_shows_the_whole_image(self, run):
        camera = list_shots(run)[0].view.camera  # 4:3
        assert normalise.window_fov(camera, 2.0) == pytest.approx(normalise.vertical_fov(camera))
        assert np.tan(normalise.window_fov(camera, 0.5) / 2) * 0.5 == pytest.approx(camera.width / camera.fx / 2)


class TestServer:
    def test_the_scene_has_gaussians_and_every_camera(self, viser, run):
        with viewing(run) as viewer:
            assert len(viewer.server.scene.get_handle_by_name("/splats").buffer) == 300
            names = {handle.name for handle in viewer.frustums.values()}
            assert names == {f"/{TRAINING}/view-0{i}" for i in range(1, 8)} | {f"/{HELD_OUT}/view-0{i}" for i in (0, 8)}
            assert viewer.server.get_port() > 0
            assert all(handle.image is not None for handle in viewer.frustums.values())

    def test_clicking_a_camera_renders_its_view(self, viser, run, monkeypatch):
        clicks = {}
        monkeypatch.setattr(viser.CameraFrustumHandle, "on_click", lambda self, call: clicks.update({self.name: call}))
        with viewing(run) as viewer:
            assert viewer.chooser.value == "view-00 (held out)"
            before = viewer.pictures["render"].image
            clicks[f"/{HELD_OUT}/view-08"](None)
            assert viewer.chooser.value == "view-08 (held out)"
            after = viewer.pictures["render"].image
            assert np.array_equal(after / np.float32(255), read_image(run.folder / "renders/view-08.png"))
            assert not np.array_equal(after, before)
            assert f"{compare(load_method(run), list_shots(run)[-1]).score:.2f} dB" in viewer.figures.content
            clicks[f"/{TRAINING}/view-03"](None)
            assert "was trained on this photograph" in viewer.figures.content

    def test_a_method_without_gaussians_still_shows_cameras_and_renders(self, viser, tmp_path):
        grey = finished_run(tmp_path, "Grey")
        with viewing(grey) as viewer:
            assert viewer.server.scene.get_handle_by_name("/splats") is None
            assert len(viewer.frustums) == 9
            assert (viewer.pictures["render"].image == 128).all()


class TestOrigins:
    @pytest.mark.parametrize(
        ("origin", "host", "own"),
        [
            ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
            ("http://localhost:9090", "LOCALHOST:9090", True),  # through a tunnel from another port
            ("http://[::1]:8080", "[::1]:8080", True),
            ("http://192.168.1.5:8080", "192.168.1.5:8080", True),  # another machine looks
            ("http://Workshop:8080", "workshop:8080", True),
            ("http://evil.example", "127.0.0.1:8080", False),
            ("http://evil.example:8080", "evil.example:8080", False),  # its name leads to this machine
            ("http://localhost.evil.example:8080", "localhost.evil.example:8080", False),
            ("http://localhost:3000", "localhost:8080", False),  # another server's page
            ("http://localhost:8080", "127.0.0.1:8080", False),
            ("http://localhost:8080@evil.example", "localhost:8080", False),
            ("http://[half", "[half", False),
            ("null", "127.0.0.1:8080", False),
            ("", "", False),
        ],
    )
    def test_pages_are_own_where_they_were_loaded_from_here(self, origin, host, own):
        assert is_own(origin, host, own_names("Workshop")) == own

    def test_only_own_pages_are_answered(self, viser, run, caplog):
        from websockets.exceptions import InvalidStatus
        from websockets.sync.client import connect

        with viewing(run) as viewer:
            port = viewer.server.get_port()

            def first_message(origin):
                protocol = f"viser-v{viser.__version__}"
                with connect(f"ws://127.0.0.1:{port}", origin=origin, subprotocols=[protocol]) as connection:
                    return connection.recv(60)

            for origin in ("http://evil.example", f"http://evil.example:{port}", "null", None):
                with pytest.raises(InvalidStatus) as refusal:
                    first_message(origin)
                assert refusal.value.response.status_code == 403
                assert b"answers its own pages only" in refusal.value.response.body
            assert "a page of http://evil.example was refused" in caplog.text
            assert first_message(f"http://127.0.0.1:{port}")
            assert b"<html" in urlopen(f"http://127.0.0.1:{port}").read()

    def test_a_viser_that_cannot_be_guarded_is_not_used(self, viser):
        with pytest.raises(InputError, match="cannot refuse other pages"), own_pages_only("127.0.0.1"):
            pass


class TestPorts:
    def test_the_next_free_port_is_taken(self):
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            assert port < free_port("127.0.0.1", port) <= port + 100

    @pytest.mark.parametrize(
        ("host", "port", "told"),
        [
            ("127.0.0.1", -1, "--port -1: no port"),
            ("127.0.0.1", 65536, "--port 65536: no port"),
            ("no such host", 8080, "--host no such host: no such address"),
            ("192.0.2.1", 8080, "192.0.2.1: nothing can be served"),  # of documentation: nobody's
        ],
    )
    def test_where_nothing_can_be_served(self, viser, host, port, told):
        with pytest.raises(InputError, match=told):
            open_viewer(Path("nowhere"), Path("data"), host, port)


class TestRuns:
    def test_a_run_is_opened_by_its_folder_and_a_missing_one_refused_with_those_there_are(self, run):
        assert open_run(run.folder, run.data.parent) == run
        assert finished_runs(run.folder.parent) == [run.folder]
        with pytest.raises(InputError, match="no such run") as refusal:
            open_run(run.folder.with_name("seed-7"), run.data.parent)
        assert str(run.folder) in str(refusal.value)

    @pytest.mark.parametrize("name", ["seed-0", "seed-5", "my favourite"])
    def test_a_run_is_what_its_settings_say_wherever_it_lies(self, run, tmp_path, name):
        moved = Path(shutil.copytree(run.folder, tmp_path / name))
        opened = open_run(moved, run.data.parent)
        assert (opened.folder, opened.method, opened.seed) == (moved, run.method, run.seed)
        assert str(opened) == str(run)
        camera = run.clean_scene().test_views[0].camera
        np.testing.assert_array_equal(load_method(opened).render(camera), load_method(run).render(camera))

    @pytest.mark.parametrize("settings", [[], {}, {"method": "3dgs"}, {"seed": "0"}])
    def test_settings_that_are_none_are_refused(self, run, tmp_path, settings):
        write_json(Path(shutil.copytree(run.folder, tmp_path / "moved")) / "config.json", settings)
        with pytest.raises(InputError, match=r"config\.json: not the settings of a run"):
            open_run(tmp_path / "moved", run.data.parent)

    def test_unfinished_runs_and_other_data_are_refused(self, run, tmp_path):
        folder = tmp_path / "results/demo/3dgs/yard/streak-0/seed-0"
        write_json(folder / "config.json", {})
        with pytest.raises(InputError, match="training has not finished"):
            open_run(folder, tmp_path)
        with pytest.raises(InputError, match="no finished scene yard"):
            open_run(run.folder, tmp_path)

    def test_without_viser_it_says_what_to_install(self, run, monkeypatch):
        monkeypatch.setitem(sys.modules, "viser", None)
        with pytest.raises(InputError, match=r"\.\[viewer\]"):
            open_viewer(Path("nowhere"), Path("data"))


def held_out(run, gaussians) -> np.ndarray:
    cameras = [view.camera.resized(96, 72) for view in run.clean_scene().test_views]
    return np.stack([np.clip(render(gaussians, camera)[0], 0, 1) for camera in cameras]).transpose(0, 3, 1, 2)


def test_ply_shows_exactly_what_the_run_shows(run, tmp_path, caplog):
    export(run.folder, tmp_path / "out.ply", "ply", None)
    assert "300 Gaussians, degree 1" in caplog.text
    own = read_ply(run.folder / "splats.ply")
    assert np.array_equal(held_out(run, read_ply(tmp_path / "out.ply")), held_out(run, own))
    assert (tmp_path / "out.ply").stat().st_size < (run.folder / "splats.ply").stat().st_size


def test_compressed_shows_nearly_what_the_run_shows(run, tmp_path):
    pytest.importorskip("gsply", reason="needs the extra compression")
    export(run.folder, tmp_path / "out.ply", "compressed", None)
    own = read_ply(run.folder / "splats.ply")
    again = replace(read_compressed_ply(tmp_path / "out.ply"), origin=own.origin)
    assert psnr(held_out(run, again), held_out(run, own)).min() > 35


def test_a_lower_degree_is_kept(run, tmp_path):
    export(run.folder, tmp_path / "out.ply", "ply", 0)
    assert read_ply(tmp_path / "out.ply").sh_degree == 0
    with pytest.raises(InputError, match="--sh-degree 2"):
        export(run.folder, tmp_path / "other.ply", "ply", 2)


def test_what_cannot_be_exported_is_refused(run, tmp_path):
    with pytest.raises(InputError, match=r"out\.splat"):
        export(run.folder, tmp_path / "out.splat", "ply", None)
    with pytest.raises(InputError, match="no such run"):
        export(tmp_path / "nowhere", tmp_path / "out.ply", "ply", None)
    grey = finished_run(tmp_path, "Grey")
    with pytest.raises(InputError, match="no Gaussians"):
        export(grey.folder, tmp_path / "out.ply", "ply", None)
