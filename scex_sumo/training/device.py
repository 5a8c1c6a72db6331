"""Device to train on: the processor or a GPU."""

from __future__ import annotations

import torch

from scex_sumo.errors import UsageError


def device_of(name: str) -> torch.device:
    """The device of a name; ``auto`` takes a GPU where there is one.

    Raises:
        UsageError: it cannot be used here.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        words = str(error).splitlines()[0]
        raise UsageError(f"--device {name}: cannot be used ({words}); give cpu, cuda or auto") from None
    return device
