"""The shape of water that clings to glass, from its outline, its contact angle and gravity.

Surface tension and weight balance where the surface's curvature follows the pressure inside (Young and Laplace). For
a flat drop of height h on an upright lens that is

    -laplace(h) = p + (y - y0) / c^2,    h = 0 on the rim,

with the capillary length c = sqrt(tension / (density g)), 2.7 mm for water. The rim is pinned: it may have any form,
and the contact angle varies along it, larger below than above, as hysteresis allows. By the divergence theorem the
mean slope at the rim is the integral of the right side over the perimeter, which fixes p for a mean contact angle.

The equation is linear and solved with linear finite elements. Steep drops need the nonlinear one; its solution for a
round drop is a sphere's cap, h = sqrt(a^2 + phi) - a with phi = r^2 - x^2 - y^2, where -laplace(phi) = 4. The same map
is applied to the phi of any outline: exact for round drops up to 90 degrees, right in the mean slope for all.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from hydroviews.rain.lens.patterns.shapes import Patch

Array = NDArray[np.float64]
Triangles = NDArray[np.int64]
HEAVIEST = 1.4  # the most that weight may add to the pressure, per radius; a heavier drop would not stay
DRIEST = 0.15  # the least pressure anywhere, in means: long trails stay wet above


def water_surface(patches: Sequence[Patch], capillary_length: float) -> tuple[list[Patch], list[Array]]:
    """Heights of the water above the lens.

    Args:
        patches: outlines; one with a `radius` is scaled about its middle until it holds the round drop's water.
        capillary_length: in the patches' unit; infinite without gravity.

    Returns:
        The patches, scaled, and for each the heights [N] of its vertices, 0 on the rim.
    """
    if not patches:
        return [], []
    load = [_pressure(patch, capillary_length) for patch in patches]
    lifts = _poisson(patches, load)
    scaled, heights = [], []
    for patch, pressure, phi in zip(patches, load, lifts, strict=True):
        areas = triangle_areas(patch.vertices, patch.triangles)
        slope = 2 * (areas * pressure[patch.triangles].mean(axis=1)).sum() / perimeter(patch)  # of phi / 2 at the rim
        flatness = slope / np.tan(patch.contact_angle)
        height = np.sqrt(flatness**2 + np.maximum(phi, 0)) - flatness
        scale = _scale(patch, areas, height)
        middle = np.average(patch.vertices[patch.triangles].mean(axis=1), axis=0, weights=areas)
        scaled.append(replace(patch, vertices=middle + scale * (patch.vertices - middle)))
        heights.append(scale * height)
    return scaled, heights


def cap_volume(radius: float, contact_angle: float) -> float:
    """Volume of a sphere's cap over a disk."""
    height = radius * np.tan(contact_angle / 2)
    return float(np.pi * height / 6 * (3 * radius**2 + height**2))


def triangle_areas(vertices: Array, triangles: Triangles) -> Array:
    """Signed areas [T] of triangles in the plane, positive if anticlockwise."""
    a, b, c = (vertices[triangles[:, i], :2] for i in range(3))
    return np.asarray(0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]))


def perimeter(patch: Patch) -> float:
    """Length of the rim: edges that belong to one triangle only."""
    edges = np.concatenate([patch.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    ends = patch.vertices[edges[first[count == 1]]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum())


def _pressure(patch: Patch, capillary_length: float) -> Array:
    """The right side at the vertices [N], 1 in the mean of a drop without gravity."""
    areas = triangle_areas(patch.vertices, patch.triangles)
    middle = np.average(patch.vertices[patch.triangles, 1].mean(axis=1), weights=areas)
    radius = np.sqrt(areas.sum() / np.pi)
    weight = (radius / capillary_length) ** 2 / (2 * np.tan(patch.contact_angle))
    return np.maximum(1 + min(weight, HEAVIEST) * (patch.vertices[:, 1] - middle) / radius, DRIEST)


def _scale(patch: Patch, areas: Array, height: Array) -> float:
    if patch.radius is None:
        return 1.0
    volume = (areas * height[patch.triangles].mean(axis=1)).sum()
    return float(np.cbrt(cap_volume(patch.radius, patch.contact_angle) / volume))


def _poisson(patches: Sequence[Patch], load: Sequence[Array]) -> list[Array]:
    """Solve -laplace(phi) = 4 load on every patch at once, phi = 0 on the rims; [N] each."""
    starts = np.cumsum([0, *(len(patch.vertices) for patch in patches)])
    vertices = np.concatenate([patch.vertices for patch in patches])
    triangles = np.concatenate([patch.triangles + start for patch, start in zip(patches, starts, strict=False)])
    inside = ~np.concatenate([patch.rim for patch in patches])
    areas = triangle_areas(vertices, triangles)
    corner_load = np.repeat(areas / 3, 3) * 4 * np.concatenate(load)[triangles].ravel()
    right = np.bincount(triangles.ravel(), corner_load, minlength=len(vertices))
    stiffness = _stiffness(vertices, triangles, areas)[inside][:, inside].tocsc()
    phi = np.zeros(len(vertices))
    options = {"SymmetricMode": True}
    phi[inside] = splu(stiffness, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve(right[inside])
    return np.split(phi, starts[1:-1])


def _stiffness(vertices: Array, triangles: Triangles, areas: Array) -> csc_array:
    """The Laplacian of linear elements (cotangent weights), positive on its diagonal [N, N]."""
    opposite = [vertices[triangles[:, (i + 2) % 3]] - vertices[triangles[:, (i + 1) % 3]] for i in range(3)]
    rows, columns, values = [], [], []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        rows.append(triangles[:, i])
        columns.append(triangles[:, j])
        values.append((opposite[i] * opposite[j]).sum(axis=1) / (4 * areas))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    half = csc_array(entries, shape=(len(vertices), len(vertices)))
    off = half + half.T
    return csc_array(off - diags_array(np.asarray(off.sum(axis=0)).ravel()))
