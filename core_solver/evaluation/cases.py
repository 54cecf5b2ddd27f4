"""What is compared in which suite: presets, and what is left out of them."""

from collections.abc import Iterable
from dataclasses import dataclass

from core_solver.errors import UserError
from core_solver.evaluation import baseline
from core_solver.optimise.presets import PRESETS, AnyPreset

ABLATION_SUITE = "ablation"


@dataclass(frozen=True)
class Ablation:
    """Terms that are switched off.

    Attributes:
        name: for tables.
        terms: names of weights; those that a preset does not have are passed over.
    """

    name: str
    terms: tuple[str, ...]

    def known_terms(self, preset: str) -> tuple[str, ...]:
        """The terms that a preset has."""
        return tuple(term for term in self.terms if term in PRESETS[preset].terms())


@dataclass(frozen=True)
class Case:
    """One way to solve a scene.

    Attributes:
        preset: name, or the baseline's.
        ablation: what is left out.
    """

    preset: str
    ablation: Ablation

    @property
    def label(self) -> str:
        """For people."""
        return label(self.preset, self.ablation.name)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Terms of the preset that are switched off; none for the baseline, which has no terms."""
        return () if self.preset == baseline.NAME else self.ablation.known_terms(self.preset)

    def settings(self) -> AnyPreset | None:
        """The preset with its terms left out; None for the baseline, which has no settings."""
        return None if self.preset == baseline.NAME else PRESETS[self.preset].without(*self.left_out)


def label(preset: str, ablation: str) -> str:
    """What a case or its row is called: the preset, and what it lacks or, in the paper's second table, consists of."""
    if ablation == FULL.name:
        return preset
    return f"{preset}, {ablation}" if ablation.startswith("E_I") else f"{preset}, no {ablation}"


FULL = Ablation("none", ())
_SCALE_PRIOR = ("height", "scale")  # ours is a prior on stature, the paper's one on the scale
_NO_CONTACT = ("contact", "slip", "penetration")

# What each part of our own method is worth.
OWN_TABLE = (
    FULL,
    Ablation("depth", ("depth",)),
    Ablation("height", _SCALE_PRIOR),
    Ablation("smpl", ("smpl", "betas")),
    Ablation("speed", ("speed",)),
    Ablation("silhouette", ("silhouette",)),
    Ablation("contact and slip", _NO_CONTACT),
    Ablation("temporal", ("temporal",)),
    Ablation("acceleration", ("acceleration",)),
    Ablation("collision", ("collision",)),
)
# The paper's table of stage I: each term of E_I left out.
PAPER_STAGE_ONE_TABLE = (
    Ablation("depth", ("depth",)),
    Ablation("scale", _SCALE_PRIOR),
    Ablation("smpl", ("smpl", "betas")),
    Ablation("speed", ("speed",)),
    Ablation("silhouette", ("silhouette",)),
    FULL,
)
# The paper's table of stage II: its terms added one by one.
PAPER_STAGE_TWO_TABLE = (
    Ablation("E_I only", (*_NO_CONTACT, "temporal")),
    Ablation("E_I + contact", ("slip", "temporal")),
    Ablation("E_I + contact + slip", ("temporal",)),
    Ablation("E_I + temporal", _NO_CONTACT),
    FULL,
)
ABLATIONS = {
    "fast": OWN_TABLE,
    "paper": (*PAPER_STAGE_ONE_TABLE, *PAPER_STAGE_TWO_TABLE),
}

_COMPARED = (baseline.NAME, "paper", "exact", "fast")


def choose_cases(suite: str, presets: Iterable[str] | None) -> tuple[Case, ...]:
    """The cases of a suite in the order of the table, each once.

    Args:
        suite: its name.
        presets: names chosen by the user; None for the suite's own.

    Raises:
        UserError: no such preset.
    """
    known = (baseline.NAME, *PRESETS)
    if presets is None:
        chosen = [name for name in (ABLATIONS if suite == ABLATION_SUITE else _COMPARED) if name in known]
    else:
        chosen = list(dict.fromkeys(presets))
    for name in chosen:
        if name not in known:
            raise UserError(f"there is no preset called {name}: choose from {', '.join(known)}")
    cases = (Case(name, ablation) for name in chosen for ablation in _ablations(suite, name))
    return tuple(dict.fromkeys(cases))


def _ablations(suite: str, preset: str) -> tuple[Ablation, ...]:
    if suite != ABLATION_SUITE or preset == baseline.NAME:
        return (FULL,)
    return tuple(a for a in ABLATIONS.get(preset, OWN_TABLE) if a is FULL or a.known_terms(preset))
