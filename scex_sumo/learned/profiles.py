"""Parameters of the learned drivers, and files of their weights."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import check_path, check_positive
from scex_sumo.behaviors.driving.paths import PathChoice

SHIPPED = Path(__file__).parent / "trained"
MODES = ("best", "draw")
HEADS = ("bounded", "free")


@dataclass(frozen=True, kw_only=True)
class GraphPredictorProfile:
    """Parameters of `GraphPredictor`.

    Attributes:
        path: index, ``straight`` or ``random``; or ``likeliest``, the path that the network prefers in the
            seed scene, drawn by its probability if ``mode=draw``.
        mode: ``best``, the expected mode; or ``draw``, drawn per vehicle and future in the seed scene.
        radius: perception radius, m.
        weights: file of weights; empty takes the shipped ones.
    """

    path: PathChoice | Literal["likeliest"] = "straight"
    mode: str = "best"
    radius: float = 100.0
    weights: str = ""

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True, kw_only=True)
class GraphImagePredictorProfile:
    """Parameters of `GraphImagePredictor`.

    Attributes:
        attention: w in [0, 1]: 1 uses the scene graph alone, 0 the road image alone.
        path: index, ``straight`` or ``random``; or ``likeliest``, the path that the network prefers.
        mode: ``best``, the expected mode; or ``draw``, drawn per vehicle and future in the seed scene.
        head: ``bounded`` drives along the path at the network's offset, within the road and the vehicle's
            limits; ``free`` takes the paper's free x, y trajectory unchanged.
        radius: perception radius, m.
        weights: file of weights; empty takes the shipped ones.
    """

    attention: float = 0.5
    path: PathChoice | Literal["likeliest"] = "likeliest"
    mode: str = "best"
    head: str = "bounded"
    radius: float = 100.0
    weights: str = ""

    def __post_init__(self) -> None:
        _check(self)
        number = isinstance(self.attention, int | float) and not isinstance(self.attention, bool)
        if not number or not 0 <= self.attention <= 1:
            raise UsageError(f"attention: got {self.attention!r}; give a number from 0 to 1")
        if self.head not in HEADS:
            raise UsageError(f"head: got {self.head!r}; give {' or '.join(HEADS)}")


@dataclass(frozen=True, kw_only=True)
class JointPredictorProfile:
    """Parameters of `JointPredictor`.

    Attributes:
        path: index, ``straight`` or ``random``; ``likeliest`` weighs probabilities of the network with those
            of `LikelyDriver` to the power of `prior`.
        mode: ``draw``, one motion for each vehicle every 0.5 s; or ``best``, the expected motion.
        temperature: 1 draws with the network's probabilities; less prefers probable motions.
        prior: power of the probabilities of `LikelyDriver`; 0 leaves them out.
        radius: perception radius, m.
        weights: file of weights; empty takes the shipped ones.
    """

    path: PathChoice | Literal["likeliest"] = "likeliest"
    mode: str = "draw"
    temperature: float = 0.95
    prior: float = 0.5
    radius: float = 100.0
    weights: str = ""

    def __post_init__(self) -> None:
        _check(self)
        check_positive(self, "temperature")
        check_positive(self, "prior", zero=True)


Profile: TypeAlias = GraphPredictorProfile | GraphImagePredictorProfile | JointPredictorProfile


def _check(profile: Profile) -> None:
    if profile.path != "likeliest":
        check_path(profile.path)
    if profile.mode not in MODES:
        raise UsageError(f"mode: got {profile.mode!r}; give {' or '.join(MODES)}")
    check_positive(profile, "radius")
    if not isinstance(profile.weights, str):
        raise UsageError(f"weights: got {profile.weights!r}; give the name of a file")


def weights_file(name: str, given: str) -> Path:
    """Return the user's file of weights, else the shipped one."""
    return Path(given).expanduser().absolute() if given else SHIPPED / f"{name}.safetensors"
