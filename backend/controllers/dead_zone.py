"""What an integrator is told of an error: nothing within a dead zone, the rest beyond it."""

from plant.compiled import compiled


@compiled
def beyond(e: float, unseen: float) -> float:
    """Return what of the error ``e`` is beyond ±``unseen``, in the same unit.

    It begins at zero, so that nothing jumps at the edge. For what is within an integrator would hunt against stiction.
    """
    return e - min(max(e, -unseen), unseen)
