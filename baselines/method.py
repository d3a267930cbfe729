"""The contract of a method, and methods by name."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, cast

import numpy as np
from numpy.typing import NDArray

from hydroviews.cli.plugins import load_plugin
from hydroviews.errors import InputError, unknown_name
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene

METHODS = "hydroviews.methods"  # entry points: subclasses of Method
WRAPPERS = "hydroviews.wrappers"  # entry points: functions that make a method of a method


@dataclass(frozen=True)
class TrainingSummary:
    """Size and cost of a trained model, as records store them.

    Scalars of numpy, torch and other libraries are converted to Python numbers.

    Raises:
        ValueError: a value is negative, not finite or not a number, or the device is missing.
    """

    train_seconds: float  # seconds of training only, summed over resumed sessions
    n_primitives: int | None  # number of Gaussians; None for methods without Gaussians
    model_mb: float | None  # size of the saved model, 10^6 bytes
    device: str  # "cpu" or the GPU's name
    used: str = ""  # parts that were switched on for these photographs; empty if all parts are always on
    render_device: str | None = None  # device of `render`; None if it equals `device`

    def __post_init__(self) -> None:
        for name in ("train_seconds", "n_primitives", "model_mb"):
            value = _plain_number(getattr(self, name))
            object.__setattr__(self, name, value)
            if value is None and name != "train_seconds":
                continue
            if not isinstance(value, int if name == "n_primitives" else int | float):
                expected = "an integer" if name == "n_primitives" else "a number"
                raise ValueError(f"summary: {name} is {value!r} of type {type(value).__name__}, expected {expected}")
            if not math.isfinite(value) or value < 0:
                raise ValueError(f"summary: {name} is {value!r}, expected a finite number, not below 0")
        for name in ("device", "used"):
            if not isinstance(getattr(self, name), str):
                raise ValueError(f"summary: {name} is {getattr(self, name)!r}, expected words")
        if not self.device:
            raise ValueError('summary: no device, expected "cpu" or the GPU\'s name')


@dataclass(frozen=True)
class Citation:
    """The publication and code that a method follows, for comparisons. A field is empty if we know of nothing."""

    title: str  # full name of the method
    paper: str = ""  # title of its publication
    authors: str = ""  # of the publication, with initials, separated by commas
    year: int | None = None
    link: str = ""  # to the publication, https
    code: str = ""  # the authors' own, https; this project contains none of it
    licence: str = ""  # of the authors' code


class Method(ABC):
    """Learns a scene from its training views, then renders any camera.

    Create a method with `Method(method.configuration(profile), seed)`, train it with `fit`, save it and load it.
    The same configuration, seed and scene give the same model.
    """

    trains_on: ClassVar[Literal["rainy", "clean"]] = "rainy"  # which photographs `fit` receives
    citation: ClassVar[Citation | None] = None  # of this class; a subclass is another method and states its own

    def __init__(self, config: Any, seed: int) -> None:
        self.config = config
        self.seed = seed

    @classmethod
    @abstractmethod
    def configuration(cls, profile: str) -> Any:
        """The settings of a profile (demo, standard or paper) as a dataclass, which `config.json` records.

        Values are numbers, strings, lists, dictionaries, dataclasses, paths and numpy arrays. A run with other values
        is another run. The method creates anything else, such as functions, from these values.

        Raises:
            InputError: no such profile.
        """

    @classmethod
    def with_max_iterations(cls, config: Any, steps: int) -> Any:
        """The same settings with at most `steps` training steps, for quick checks.

        The default limits every field `iterations` in the dataclass and in nested dataclasses. Override this method if
        the settings count steps in another way, or if the schedule needs more changes.
        """
        return _limited(config, steps)

    @abstractmethod
    def fit(self, scene: Scene, folder: Path) -> None:
        """Train on `scene.train_views` only, with a progress bar. Pixels that `View.ignored` hides have no effect.

        Checkpoints are written to `folder`. If the folder holds a checkpoint of this configuration and seed, training
        resumes from it and gives the same result as an uninterrupted training.

        Raises:
            InputError: a view cannot be read, or a checkpoint belongs to another configuration or scene.
        """

    @abstractmethod
    def render(self, camera: Camera) -> Image:
        """Render the scene without rain: float32 [H, W, 3], sRGB-encoded, [0, 1]."""

    def hidden(self, view: int, size: tuple[int, int]) -> NDArray[np.float32] | None:
        """The share of each pixel of a training view that the method ignores as an occluder, after `fit`.

        Args:
            view: index among the training views.
            size: its height and width.

        Returns:
            [H, W] in [0, 1], 0 where the pixel shows only the scene; None if the method ignores no pixels.
        """
        return None

    @abstractmethod
    def save(self, folder: Path) -> None:
        """Write everything that `load` needs."""

    @classmethod
    @abstractmethod
    def load(cls, config: Any, seed: int, folder: Path) -> Self:
        """Load the model that `save` wrote to `folder`. The loaded model renders the same pixels.

        Raises:
            InputError: the folder holds no model.
        """

    @abstractmethod
    def summary(self) -> TrainingSummary:
        """Training time and size of the trained model."""


def _plain_number(value: Any) -> Any:
    """A library's scalar, an array without axes, as Python's number; anything else as it is."""
    return value.item() if getattr(value, "shape", None) == () and hasattr(value, "item") else value


def check_render(image: Any, camera: Camera) -> None:
    """Refuse a render that is not what `Method.render` promises.

    Raises:
        ValueError: it is something else than float32 [H, W, 3], finite, in [0, 1]; says what was found.
    """
    expected = camera.height, camera.width, 3
    if not isinstance(image, np.ndarray) or image.shape != expected or image.dtype != np.float32:
        found = f"{getattr(image, 'dtype', type(image).__name__)} {np.shape(image)}"
        raise ValueError(f"rendered {found}, expected float32 {expected}")
    with np.errstate(invalid="ignore"):  # comparisons with NaN
        faults = {"NaN": np.isnan(image), "infinite": np.isinf(image), "below 0": image < 0, "above 1": image > 1}
    counts = {fault: int(where.any(axis=2).sum()) for fault, where in faults.items()}
    if any(counts.values()):
        found = ", ".join(f"{fault} in {count:,}" for fault, count in counts.items() if count)
        pixels = f"{image.shape[0] * image.shape[1]:,} pixels"
        raise ValueError(f"rendered {found} of {pixels}, expected finite values in [0, 1]")


def check_hidden(plane: Any, size: tuple[int, int]) -> None:
    """Refuse a plane that is not what `Method.hidden` promises for a view of (height, width).

    Raises:
        ValueError: it is something else than float32 [H, W], in [0, 1]; says what was found.
    """
    if not isinstance(plane, np.ndarray) or plane.shape != size or plane.dtype != np.float32:
        found = f"{getattr(plane, 'dtype', type(plane).__name__)} {np.shape(plane)}"
        raise ValueError(f"hidden is {found}, expected float32 {size}")
    if not (plane >= 0).all() or not (plane <= 1).all():
        raise ValueError(f"hidden is {plane.min():g} to {plane.max():g}, expected finite values in [0, 1]")


def named(kind: type[Method], name: str, text: str) -> type[Method]:
    """The class under another name and with another docstring: what a wrapper makes is named after what it wraps."""
    kind.__name__ = kind.__qualname__ = name
    kind.__doc__ = text
    return kind


def profile_settings(profile: str, profiles: Mapping[str, Any]) -> Any:
    """A method's settings for a profile, where it keeps them by name.

    Raises:
        InputError: no such profile.
    """
    if profile not in profiles:
        raise unknown_name(f"PROFILE={profile}", profile, "profile", profiles)
    return profiles[profile]


def citation_of(name: str) -> Citation | None:
    """The citation of a method by its name, without its wrappers; None if its class has none."""
    found: Citation | None = vars(find_method(name.partition("+")[0])).get("citation")
    return found


def find_method(name: str) -> type[Method]:
    """The method class of a registered name, or of `package.module:Class`.

    `NAME+WRAPPER` applies a wrapper to a method. A wrapper is a registered name or `package.module:function`.

    Raises:
        InputError: no such method or wrapper.
    """
    first, *wrappers = name.split("+")
    found = _checked(name, first, load_plugin(f"METHOD={name}", first, METHODS, "method", "Class"))
    for part in wrappers:
        found = _checked(name, part, find_wrapper(part, name)(found))
    return found


def find_wrapper(part: str, name: str = "") -> Callable[[type[Method]], type[Method]]:
    """The wrapper of a registered name, or of `package.module:function`.

    Args:
        part: its name.
        name: of the method that it is a part of, for errors.

    Raises:
        InputError: no such wrapper.
    """
    wrap = load_plugin(f"METHOD={name or part}", part, WRAPPERS, "wrapper", "function")
    if isinstance(wrap, type) or not callable(wrap):
        raise InputError(f"METHOD={name or part}: {part} is not a wrapper", expected="a function from Method to Method")
    return cast(Callable[[type[Method]], type[Method]], wrap)


def _checked(name: str, part: str, found: Any) -> type[Method]:
    if not (isinstance(found, type) and issubclass(found, Method)):
        raise InputError(
            f"METHOD={name}: {part} is not a method", found=found, expected="a subclass of baselines.method.Method"
        )
    if found.trains_on not in ("rainy", "clean"):
        raise InputError(f"METHOD={name}: unknown trains_on", found=found.trains_on, expected="rainy or clean")
    return found


def _limited(settings: Any, steps: int) -> Any:
    """A dataclass with at most so many `iterations`, in itself and in the dataclasses it holds."""
    if not is_dataclass(settings) or isinstance(settings, type):
        return settings
    values = {field.name: _limited(getattr(settings, field.name), steps) for field in fields(settings) if field.init}
    if isinstance(values.get("iterations"), int):
        values["iterations"] = min(values["iterations"], steps)
    return replace(settings, **values)
