"""What all presets have in common: terms that can be switched off."""

from dataclasses import dataclass, replace
from typing import Generic, Self, TypeVar

from core_solver.energy.paper import PaperWeights
from core_solver.energy.weights import Weights

W = TypeVar("W", Weights, PaperWeights)


@dataclass(frozen=True)
class Switchable(Generic[W]):
    """A name and weights of terms.

    Attributes:
        name: for the command line and the take.
        weights: of the terms; 0 switches one off.
    """

    name: str
    weights: W

    def terms(self) -> tuple[str, ...]:
        """What can be switched off."""
        return self.weights.terms()

    def without(self, *terms: str) -> Self:
        """The same with these terms switched off; a term is named as its weight is.

        Raises:
            ValueError: no such term.
        """
        for term in terms:
            if term not in self.terms():
                raise ValueError(f"no term is called {term}: choose from {', '.join(self.terms())}")
        return replace(self, weights=replace(self.weights, **dict.fromkeys(terms, 0.0)))
