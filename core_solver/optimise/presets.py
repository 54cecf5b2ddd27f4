"""Named ways to solve, from the paper's own to ours."""

from dataclasses import dataclass

from core_solver.energy.weights import Weights
from core_solver.optimise.looking import Look
from core_solver.optimise.paper import PaperPreset
from core_solver.optimise.second_order import Schedule
from core_solver.optimise.switches import Switchable


@dataclass(frozen=True)
class Preset(Switchable[Weights]):
    """A name for what is minimised and how.

    Attributes:
        name: for the command line and the take.
        weights: of the energies.
        stage_one: scale and depth.
        stage_two: space and time.
        look: at the picture, until the last iterations.
        last_look: in the last iterations.
        last_iterations: of stage two, besides `stage_two.iterations`.
    """

    stage_one: Schedule
    stage_two: Schedule
    look: Look
    last_look: Look
    last_iterations: Schedule


_EACH_PIXEL = Look(320, 64, each_pixel=True)

FAST = Preset(
    "fast", Weights(), Schedule(5, 2e-3), Schedule(8, 2e-3), Look(320, 32, each_pixel=False), _EACH_PIXEL,
    Schedule(2, 1e-3),
)  # fmt: skip
EXACT = Preset("exact", Weights(), Schedule(8, 1e-3), Schedule(20, 3e-4), _EACH_PIXEL, _EACH_PIXEL, Schedule(2, 1e-4))
AnyPreset = Preset | PaperPreset
PRESETS: dict[str, AnyPreset] = {preset.name: preset for preset in (FAST, EXACT, PaperPreset())}
