"""The contract every method meets, and how a method is found by name."""

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
    """What a trained model is and what it cost, as runs record it.

    Scalars of numpy, torch and other libraries become Python's numbers.

    Raises:
        ValueError: a number that is negative or not finite, or something else than a number; no device.
    """

    train_seconds: float  # training alone, summed over resumed sessions
    n_primitives: int | None  # Gaussians; None for methods that have none
    model_mb: float | None  # arrays of the saved model, in 10^6 bytes
    device: str  # "cpu" or the GPU's name
    used: str = ""  # in words, the parts that it switched on for these photographs; empty if it always uses all
    render_device: str | None = None  # as `device`, of what `render` calculates on; None where it is the same

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


class Method(ABC):
    """Learns a scene from its training views, then renders any camera.

    A method is made with `Method(method.configuration(profile), seed)`, taught with `fit`, saved and loaded.
    The same configuration, seed and scene give the same model.
    """

    trains_on: ClassVar[Literal["rainy", "clean"]] = "rainy"  # which photographs it is shown

    def __init__(self, config: Any, seed: int) -> None:
        self.config = config
        self.seed = seed

    @classmethod
    @abstractmethod
    def configuration(cls, profile: str) -> Any:
        """The dataclass of settings for profile demo, quick or paper, which `config.json` records.

        Its values are numbers, strings, lists, dictionaries, dataclasses, paths and numpy arrays: a run with other
        ones is another run. Whatever else a method needs, such as functions, it makes of these.

        Raises:
            InputError: no such profile.
        """

    @classmethod
    def with_max_iterations(cls, config: Any, steps: int) -> Any:
        """The same settings with no more than `steps` training steps, so that a method can be checked quickly.

        This limits `iterations` of the dataclass and of those it holds, and leaves others as they are. A method that
        counts otherwise, or whose schedule breaks when it is cut short, says here what to do.
        """
        return _limited(config, steps)

    @abstractmethod
    def fit(self, scene: Scene, folder: Path) -> None:
        """Learn from `scene.train_views` alone, showing progress; what `View.ignored` hides is not looked at.

        Checkpoints go to `folder`; if it holds one of this configuration and seed, training goes on from it
        and ends as if it had never been interrupted.

        Raises:
            InputError: a view that cannot be read, or a checkpoint of another configuration or scene.
        """

    @abstractmethod
    def render(self, camera: Camera) -> Image:
        """The learned scene without rain: float32 [H, W, 3], sRGB-encoded, [0, 1]."""

    def hidden(self, view: int, size: tuple[int, int]) -> NDArray[np.float32] | None:
        """How much of each pixel of a training view is attributed to occluders in front of the scene, after `fit`.

        Args:
            view: index among the training views.
            size: its height and width.

        Returns:
            [H, W] in [0, 1], 0 where all is the scene's; None where the method does not look for such.
        """
        return None

    @abstractmethod
    def save(self, folder: Path) -> None:
        """Write all that `load` needs."""

    @classmethod
    @abstractmethod
    def load(cls, config: Any, seed: int, folder: Path) -> Self:
        """The model `save` wrote to `folder`; it renders the same pixels.

        Raises:
            InputError: no model there.
        """

    @abstractmethod
    def summary(self) -> TrainingSummary:
        """Time and size of the trained model."""


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


def find_method(name: str) -> type[Method]:
    """The method class of a registered name, or of `package.module:Class`.

    `NAME+WRAPPER` is a method that a wrapper makes of another; wrappers are registered too, or are
    `package.module:function`.

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
