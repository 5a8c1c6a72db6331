"""Parameters of the learned drivers, and the files of their weights."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from scex_sumo.behaviors.driving.paths import PathChoice
from scex_sumo.behaviors.parameters import check_path, check_positive
from scex_sumo.errors import UsageError

SHIPPED = Path(__file__).parents[1] / "weights"
MODES = ("best", "draw")
HEADS = ("bounded", "free")


@dataclass(frozen=True, kw_only=True)
class GraphPredictorProfile:
    """Parameters of `GraphPredictor`.

    Attributes:
        path: which path to take, as in `IdmProfile`; or ``likeliest``, the one that the network thinks it
            takes, from the seed scene: with ``mode=draw`` each as often as it is probable.
        mode: ``best``, what the network expects; or ``draw``, one of its modes for each vehicle of a child,
            as often as it is probable in the seed scene.
        radius: perception radius, m.
        weights: file of weights; empty takes the shipped ones.
    """

    path: PathChoice | Literal["likeliest"] = "straight"
    mode: str = "best"
    radius: float = 100.0
    weights: str = ""

    def __post_init__(self) -> None:
        check_learned(self)


def check_learned(profile: Any) -> None:
    """Raise a `UsageError` unless path, mode, radius and weights of a learned driver make sense."""
    if profile.path != "likeliest":
        check_path(profile.path)
    if profile.mode not in MODES:
        raise UsageError(f"mode: got {profile.mode!r}; give {' or '.join(MODES)}")
    check_positive(profile, "radius")
    if not isinstance(profile.weights, str):
        raise UsageError(f"weights: got {profile.weights!r}; give the name of a file")


def weights_file(name: str, given: str) -> Path:
    """The file of weights of a learned driver: the user's, else the shipped one."""
    return Path(given).expanduser().absolute() if given else SHIPPED / f"{name}.safetensors"


@dataclass(frozen=True, kw_only=True)
class GraphImagePredictorProfile:
    """Parameters of `GraphImagePredictor`.

    Attributes:
        attention: w in [0, 1]: 1 looks at the scene graph alone, 0 at the road from above alone.
        path: as in `GraphPredictorProfile`.
        mode: as in `GraphPredictorProfile`.
        head: ``bounded`` drives along the path, at the offset that the network wants, within the road and
            what a car can do; ``free`` takes the paper's free x, y trajectory as it is.
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
        check_learned(self)
        number = isinstance(self.attention, int | float) and not isinstance(self.attention, bool)
        if not number or not 0 <= self.attention <= 1:
            raise UsageError(f"attention: got {self.attention!r}; give a number from 0 to 1")
        if self.head not in HEADS:
            raise UsageError(f"head: got {self.head!r}; give {' or '.join(HEADS)}")
