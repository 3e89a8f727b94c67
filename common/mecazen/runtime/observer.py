"""What only observes: it takes everything, answers nothing, and no tick waits for it."""

from __future__ import annotations

from abc import abstractmethod

from mecazen.runtime.participant import Participant


class Observer(Participant):
    """A service that shows or keeps what the nodes publish."""

    @abstractmethod
    def reset(self, seed: int) -> None:
        """Begin a run."""
