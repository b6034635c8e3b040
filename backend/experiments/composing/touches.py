"""What an experiment learns and gives way to, as it is laid out, and what of it makes no sense. Pure."""

from backend.realtime.program import MAX_TOUCHES, NEIGHBOUR, Touch

LEARNING_S = 2.0
"""Least rest [s] that is learned from; seven times as long as its mean reaches back (``touch.MEAN_S``)."""


class Touches:
    """Touches in their order; each begins with the next segment, and what changes before there is one is one change."""

    def __init__(self) -> None:
        self.made: list[Touch] = []
        self._begun = 0
        self._within = False
        self._learned: list[float] = []

    @property
    def unused_learning(self) -> bool:
        """Whether something was learned as the last thing of all."""
        return len(self.made) > self._begun and self.made[-1].learns

    def learn(self, S: float) -> str:
        """Learn what is felt at rest at S [N·m/rad]; why that cannot be, empty where it can."""
        if self._within:
            return "nothing is learned within what a contact ends: learn before it"
        self._learned.append(S)
        return self._put(Touch(0.0, learns=True))

    def open(self, contact_N: float, S: float) -> str:
        """Let contacts above contact_N [N] end what comes, which begins at S [N·m/rad]; why not, empty where it can."""
        if self._within:
            return "a contact ends this already: what it ends has no part of its kind"
        if not self._learned:
            return "nothing was learned before it: let the joint rest in a part `do: learn` first, at this stiffness"
        if not min(self._learned) - NEIGHBOUR <= S <= max(self._learned) + NEIGHBOUR:
            known = ", ".join(f"{learned:.4g}" for learned in sorted(set(self._learned)))
            return f"at {S:.4g} N·m/rad nothing was learned, only at {known}: let the joint rest in a part `do: learn`"
        self._within = True
        return self._put(Touch(contact_N))

    def close(self) -> str:
        """Let contacts end nothing more."""
        self._within = False
        return self._put(Touch())

    def of_next(self) -> int:
        """Return the number of the touch that begins with the next segment, 0 for none."""
        if len(self.made) == self._begun:
            return 0
        self._begun = len(self.made)
        return self._begun

    def _put(self, touch: Touch) -> str:
        if len(self.made) > self._begun:
            self.made[-1] = Touch(touch.contact_N, self.made[-1].learns or touch.learns)
            return ""
        if len(self.made) == MAX_TOUCHES:
            return f"{MAX_TOUCHES} changes of what is given way to are the most: split the experiment"
        self.made.append(touch)
        return ""
