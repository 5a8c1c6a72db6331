"""Parameters of the learned drivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import check_path, check_positive
from scex_sumo.behaviors.driving.paths import PathChoice

MODES = ("best", "draw")
HEADS = ("bounded", "free")


@dataclass(frozen=True, kw_only=True)
class GraphPredictorProfile:
    """Parameters of `graph_predictor`.

    Attributes:
        path: index, ``straight`` or ``random``; or ``likeliest``, the path that the network prefers in the
            seed scene, drawn by its probability if ``mode=draw``.
        mode: ``best``, the expected mode; or ``draw``, drawn per vehicle and future in the seed scene.
        weights: file of weights; empty takes the shipped ones.
    """

    path: PathChoice | Literal["likeliest"] = "straight"
    mode: str = "best"
    weights: str = ""

    def __post_init__(self) -> None:
        if self.path != "likeliest":
            check_path(self.path)
        if self.mode not in MODES:
            raise UsageError(f"mode: got {self.mode!r}; give {' or '.join(MODES)}")
        if not isinstance(self.weights, str):
            raise UsageError(f"weights: got {self.weights!r}; give the name of a file")


@dataclass(frozen=True, kw_only=True)
class GraphImagePredictorProfile(GraphPredictorProfile):
    """Parameters of `graph_image_predictor`.

    Attributes:
        attention: w in [0, 1]: 1 uses the scene graph alone, 0 the road image alone.
        head: ``bounded`` drives along the path at the network's offset, within the road and the vehicle's
            limits; ``free`` takes the paper's free x, y trajectory unchanged.
    """

    attention: float = 0.5
    path: PathChoice | Literal["likeliest"] = "likeliest"
    head: str = "bounded"

    def __post_init__(self) -> None:
        super().__post_init__()
        number = isinstance(self.attention, int | float) and not isinstance(self.attention, bool)
        if not number or not 0 <= self.attention <= 1:
            raise UsageError(f"attention: got {self.attention!r}; give a number from 0 to 1")
        if self.head not in HEADS:
            raise UsageError(f"head: got {self.head!r}; give {' or '.join(HEADS)}")


@dataclass(frozen=True, kw_only=True)
class JointPredictorProfile(GraphPredictorProfile):
    """Parameters of `joint_predictor`.

    Attributes:
        path: index, ``straight`` or ``random``; ``likeliest`` weighs probabilities of the network with those
            of `LikelyDriver` to the power of `prior`.
        mode: ``draw``, one motion for each vehicle every 0.5 s; or ``best``, the expected motion.
        temperature: 1 draws with the network's probabilities; less prefers probable motions.
        prior: power of the probabilities of `LikelyDriver`; 0 leaves them out.
    """

    path: PathChoice | Literal["likeliest"] = "likeliest"
    mode: str = "draw"
    temperature: float = 0.95
    prior: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "temperature")
        check_positive(self, "prior", zero=True)
