"""A trained scene in a browser: free flight through its Gaussians, its cameras with their photographs, its errors."""

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.method import Method
from baselines.splatting.gaussians import Gaussians
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera, fitted_size
from hydroviews.scene.images import resize_area, to_uint8
from leaderboard.runs.finished_runs import find_splats, load_method, open_run
from leaderboard.runs.run import Run
from leaderboard.viewer.comparison import SHOWN, ComparedView, Shot, compare, list_shots
from leaderboard.viewer.normalise import (
    SIZE,
    Normalisation,
    frustum_length,
    normalise_scene,
    normalise_splats,
    pose,
    vertical_fov,
    window_fov,
)
from leaderboard.viewer.origins import own_pages_only
from leaderboard.viewer.ports import free_port

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)

HOST, PORT = "127.0.0.1", 8080
INSTALL = ".venv/bin/pip install --constraint constraints.txt --editable '.[viewer]'"
TRAINING, HELD_OUT = "training", "held-out"
COLOURS = {TRAINING: (70, 130, 230), HELD_OUT: (240, 140, 40)}
THUMBNAIL = 160  # pixels, the longer side of a photograph on a frustum
LARGE = 0.1  # length over distance from which a frustum stands in the way
LINE = 0.04  # thickness over the length of a frustum
PICTURES = {"photograph": "photograph", "render": "the trained scene", "error": "error x4"}
EMPTY = np.zeros((1, 1, 3), np.uint8)
STEPS, SECONDS = 24, 0.6  # of a flight to a camera


@dataclass(frozen=True)
class Viewer:
    """A running server and the handles of what it shows."""

    server: "viser.ViserServer"
    normalisation: Normalisation
    length: float  # of a frustum
    frustums: Mapping[str, "viser.CameraFrustumHandle"]  # by the label of the shot
    chooser: Any  # viser.GuiDropdownHandle; its value is the label of what is compared
    figures: "viser.GuiMarkdownHandle"
    pictures: Mapping[str, "viser.GuiImageHandle"]  # by the fields of `ComparedView`


def view(folder: Path, data: Path, host: str = HOST, port: int = PORT) -> None:
    """Show a run until Ctrl-C.

    Raises:
        InputError: no finished run, other data than it was trained on, nowhere to serve at, or no viser.
    """
    viewer = open_viewer(folder, data, host, port)
    try:
        address = f"[{host}]" if ":" in host else host
        logger.info("%s: open http://%s:%d in a browser; Ctrl-C ends it", folder, address, viewer.server.get_port())
        viewer.server.sleep_forever()
    finally:
        viewer.server.stop()


def open_viewer(folder: Path, data: Path, host: str = HOST, port: int = PORT) -> Viewer:
    """Start the server and put the scene into it; the first held-out view is compared.

    Raises:
        InputError: see `view`.
    """
    viser = _import_viser()
    free_port(host, port)  # before anything that takes long
    run = open_run(folder, data)
    method, gaussians, shots = load_method(run), find_splats(folder), list_shots(run)
    cameras = [shot.view.camera for shot in shots]
    normalisation = normalise_scene(cameras, gaussians)
    first = next(shot for shot in shots if shot.held_out)
    comparison = compare(method, first)  # before a port is taken: kernels may have to be compiled
    with own_pages_only(host):
        server = viser.ViserServer(host, free_port(host, port), label=str(run), verbose=False)
    server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, control_width="large")
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction(normalisation.up)
    server.initial_camera.position = normalisation.place(first.view.camera.centre)
    server.initial_camera.look_at = server.initial_camera.position + SIZE * first.view.camera.rotation[2]
    server.initial_camera.fov = vertical_fov(first.view.camera)
    if gaussians is not None:
        server.scene.add_gaussian_splats("/splats", **vars(normalise_splats(gaussians, cameras, normalisation)))
    server.gui.add_markdown(_title(run, gaussians))
    length = frustum_length(cameras, normalisation)
    frustums = add_frustums(server, shots, normalisation, length)
    add_switches(server, frustums)
    chooser = server.gui.add_dropdown("view", [shot.label for shot in shots], initial_value=first.label)
    figures = server.gui.add_markdown("")
    pictures = {name: server.gui.add_image(EMPTY, label=label) for name, label in PICTURES.items()}
    viewer = Viewer(server, normalisation, length, frustums, chooser, figures, pictures)
    put_comparison(viewer, first, comparison)
    connect(viewer, method, shots)
    return viewer


def add_frustums(
    server: "viser.ViserServer", shots: Sequence[Shot], normalisation: Normalisation, length: float
) -> dict[str, "viser.CameraFrustumHandle"]:
    """Put every camera into the scene, with a small copy of its photograph; training and held-out ones apart."""
    for group in COLOURS:
        server.scene.add_frame(f"/{group}", show_axes=False)
    handles = {}
    for shot in tqdm(shots, desc="photographs", unit="view", leave=False):
        camera, group = shot.view.camera, HELD_OUT if shot.held_out else TRAINING
        wxyz, position = pose(camera, normalisation)
        handles[shot.label] = server.scene.add_camera_frustum(
            f"/{group}/{shot.view.name}",
            fov=vertical_fov(camera),
            aspect=camera.width / camera.fx / (camera.height / camera.fy),
            scale=length,
            thickness=LINE * length,
            color=COLOURS[group],
            image=_thumbnail(shot),
            wxyz=wxyz,
            position=position,
        )
    return handles


def add_switches(server: "viser.ViserServer", frustums: Mapping[str, "viser.CameraFrustumHandle"]) -> None:
    """Check boxes for what is in the scene."""
    nodes = {"Gaussians": "/splats", "training cameras": f"/{TRAINING}", "held-out cameras": f"/{HELD_OUT}"}
    for label, name in nodes.items():
        handle = server.scene.get_handle_by_name(name)
        if handle is not None:
            _switch(server, label, partial(setattr, handle, "visible"))
    thumbnails = {label: frustum.image for label, frustum in frustums.items()}

    def show_photographs(shown: bool) -> None:
        for label, frustum in frustums.items():
            frustum.image = thumbnails[label] if shown else None

    _switch(server, "photographs", show_photographs)


def _switch(server: "viser.ViserServer", label: str, change: Callable[[bool], None]) -> None:
    box = server.gui.add_checkbox(label, initial_value=True)
    box.on_update(lambda _: change(box.value))


def connect(viewer: Viewer, method: Method, shots: Sequence[Shot]) -> None:
    """Let the list of views and clicks on cameras choose what is compared, and fly there."""
    by_label = {shot.label: shot for shot in shots}
    one_at_a_time = threading.Lock()

    def show(label: str) -> None:
        with one_at_a_time:
            put_comparison(viewer, by_label[label], compare(method, by_label[label]))
            for client in viewer.server.get_clients().values():
                fly(client, by_label[label].view.camera, viewer.normalisation)

    def choose(label: str, _: object) -> None:
        if viewer.chooser.value == label:
            show(label)
        else:
            viewer.chooser.value = label  # which calls show

    viewer.chooser.on_update(lambda _: show(viewer.chooser.value))
    for label, frustum in viewer.frustums.items():
        frustum.on_click(partial(choose, label))


def put_comparison(viewer: Viewer, shot: Shot, comparison: ComparedView) -> None:
    """Show a comparison, and hide the frustums that would stand in its camera's way, its own among them."""
    hidden = in_the_way(viewer, shot)
    for label, frustum in viewer.frustums.items():
        if frustum.visible == (label in hidden):
            frustum.visible = label not in hidden
    for name, handle in viewer.pictures.items():
        handle.image = to_uint8(getattr(comparison, name))
    if comparison.score is not None:
        words = f"held out, **{SHOWN.title} {SHOWN.text(comparison.score)} {SHOWN.unit}** against the clean view"
    elif shot.held_out:
        words = "held out; it rained, so there is no clean view to score against"
    else:
        words = "the method was trained on this photograph"
    viewer.figures.content = f"{shot.view.name}: {words}"


def in_the_way(viewer: Viewer, shot: Shot) -> set[str]:
    """The cameras so close to that of a shot that their frustums would look large from there."""
    here = viewer.normalisation.place(shot.view.camera.centre)
    return {
        label
        for label, frustum in viewer.frustums.items()
        if np.linalg.norm(frustum.position - here) < viewer.length / LARGE
    }


def fly(client: "viser.ClientHandle", camera: Camera, normalisation: Normalisation) -> None:
    """Take a window to a camera: along a screw motion, until it shows the whole image."""
    from viser.transforms import SE3, SO3

    wxyz, position = pose(camera, normalisation)
    start = SE3.from_rotation_and_translation(SO3(client.camera.wxyz), client.camera.position)
    motion = (start.inverse() @ SE3.from_rotation_and_translation(SO3(wxyz), position)).log()
    start_fov, fov = client.camera.fov, window_fov(camera, client.camera.aspect)
    for share in (np.arange(STEPS) + 1) / STEPS:
        now = start @ SE3.exp(share * motion)
        with client.atomic():
            client.camera.wxyz = now.rotation().wxyz
            client.camera.position = now.translation()
            client.camera.fov = float(start_fov + share * (fov - start_fov))
        client.flush()
        time.sleep(SECONDS / STEPS)
    client.camera.look_at = position + SIZE * camera.rotation[2]  # what the mouse turns about


def _thumbnail(shot: Shot) -> NDArray[np.uint8]:
    image = shot.view.image()
    return to_uint8(resize_area(image, *fitted_size(image.shape[1], image.shape[0], THUMBNAIL)))


def _title(run: Run, gaussians: Gaussians | None) -> str:
    if gaussians is None:
        return f"**{run}**\n\n{run.method} leaves no Gaussians: cameras and rendered images are all there is to see."
    return f"**{run}**\n\n{len(gaussians):,} Gaussians"


def _import_viser() -> ModuleType:
    try:
        import viser
    except ImportError as error:
        raise InputError("the viewer needs viser", found=error, fix=INSTALL) from None
    return viser
