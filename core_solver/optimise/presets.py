"""Named ways to solve, from the paper's own to ours."""

from dataclasses import dataclass, replace

from core_solver.energy.weights import Weights
from core_solver.optimise.second_order import Schedule


@dataclass(frozen=True)
class Preset:
    """A name for what is minimised and how.

    Attributes:
        name: for the command line and the take.
        weights: of the energies.
        stage_one: scale and depth.
        stage_two: space and time.
    """

    name: str
    weights: Weights
    stage_one: Schedule
    stage_two: Schedule

    def without(self, *terms: str) -> "Preset":
        """The same with these terms switched off; a term is named as its weight is.

        Raises:
            ValueError: no such term.
        """
        for term in terms:
            if term not in Weights.terms():
                raise ValueError(f"no term is called {term}: choose from {', '.join(Weights.terms())}")
        return replace(self, weights=replace(self.weights, **dict.fromkeys(terms, 0.0)))


PRESETS = {preset.name: preset for preset in (Preset("fast", Weights(), Schedule(6, 1e-3), Schedule(12, 1e-3)),)}
