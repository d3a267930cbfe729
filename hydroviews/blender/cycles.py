"""Cycles on the CPU: settings, cameras, and renders as arrays in linear light."""

import os
import tempfile
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from hydroviews.blender.embedded_scenes.meshes import Mesh
from hydroviews.blender.embedded_scenes.pieces import Lamp
from hydroviews.scene.cameras import Camera

SENSOR_MM = 36.0
FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])  # Blender's camera looks along -z with y up


def empty_scene(seed: int) -> bpy.types.Scene:
    """A scene with nothing in it but a camera, rendered by Cycles on the CPU without denoising.

    A process may hold one scene: this throws away all that was there.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_percentage = 100
    scene.render.use_persistent_data = True
    scene.render.threads_mode = "FIXED"
    scene.render.threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    scene.cycles.device = "CPU"
    scene.cycles.seed = seed % 2**31  # Blender's integers are signed and short
    scene.cycles.use_animated_seed = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.use_auto_tile = False
    scene.cycles.caustics_reflective = False
    scene.cycles.caustics_refractive = False
    scene.view_settings.view_transform = "Raw"
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def place_camera(scene: bpy.types.Scene, camera: Camera) -> None:
    """Give the scene's camera the size, intrinsics and pose of `camera`."""
    aspect = camera.fx / camera.fy  # height of a pixel over its width
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = max(1.0, 1 / aspect), max(1.0, aspect)
    scene.render.resolution_x, scene.render.resolution_y = camera.width, camera.height
    lens = scene.camera.data
    lens.sensor_fit = "HORIZONTAL"
    lens.sensor_width = SENSOR_MM
    lens.lens = camera.fx / camera.width * SENSOR_MM
    lens.shift_x = (camera.width / 2 - camera.cx) / camera.width
    lens.shift_y = (camera.cy - camera.height / 2) * aspect / camera.width
    lens.clip_start, lens.clip_end = 0.01, 1e5
    scene.camera.matrix_world = Matrix((np.linalg.inv(camera.world_to_camera) @ FROM_OPENCV).tolist())
    bpy.context.view_layer.update()


def add_mesh(scene: bpy.types.Scene, name: str, mesh: Mesh, material: bpy.types.Material) -> bpy.types.Object:
    """Put a mesh of one material into the scene, its axes along the world's."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(mesh.vertices.tolist(), [], mesh.faces)
    data.polygons.foreach_set("use_smooth", [mesh.smooth] * len(data.polygons))
    data.materials.append(material)
    item = bpy.data.objects.new(name, data)
    scene.collection.objects.link(item)
    return item


def add_lamp(scene: bpy.types.Scene, lamp: Lamp) -> bpy.types.Object:
    """Put a source of light into the scene that lights surfaces and shows in glossy ones alone."""
    light = bpy.data.lights.new(lamp.name, "POINT" if lamp.size is None else "AREA")
    light.energy, light.color = lamp.watts, lamp.colour
    if lamp.size is None:
        light.shadow_soft_size = lamp.radius
    else:
        light.shape, light.size, light.size_y = "RECTANGLE", *lamp.size
    item = bpy.data.objects.new(lamp.name, light)
    item.location = lamp.position
    item.rotation_mode = "QUATERNION"
    item.rotation_quaternion = Vector(lamp.direction).to_track_quat("-Z", "Y")
    item.visible_camera = False
    scene.collection.objects.link(item)
    return item


def render_rgba(scene: bpy.types.Scene) -> NDArray[np.float32]:
    """Render once: float32 [H, W, 4], linear radiance and coverage."""
    settings = scene.render.image_settings
    settings.media_type = "IMAGE"
    settings.file_format = "OPEN_EXR"
    settings.color_mode = "RGBA"
    channels = _render_channels(scene)
    return np.stack([channels[name] for name in "RGBA"], axis=-1)


def render_positions(scene: bpy.types.Scene) -> NDArray[np.float32]:
    """World position behind each pixel's centre: float32 [H, W, 3], NaN where there is only sky.

    Leaves the scene set to one sample a pixel.
    """
    layer = scene.view_layers[0]
    layer.use_pass_position = layer.use_pass_z = True
    scene.cycles.use_denoising = False
    scene.cycles.samples = 1
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = 0.01  # all samples at the pixel's centre
    settings = scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    channels = {name.partition(".")[2]: values for name, values in _render_channels(scene).items()}
    depth = channels["Depth.V"] if "Depth.V" in channels else channels["Depth.Z"]
    positions = np.stack([channels[f"Position.{axis}"] for axis in "XYZ"], axis=-1)
    positions[depth > scene.camera.data.clip_end] = np.nan
    return positions


def _render_channels(scene: bpy.types.Scene) -> dict[str, NDArray[np.float32]]:
    # Blender hands a render over only through a file.
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.exr_codec = "ZIP"
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as folder:
        path = Path(folder) / "render.exr"
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)
        file = OpenEXR.File(str(path), separate_channels=True)
        return {
            name: np.array(channel.pixels, np.float32) for part in file.parts for name, channel in part.channels.items()
        }
