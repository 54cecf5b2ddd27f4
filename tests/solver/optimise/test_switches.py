from dataclasses import replace

import pytest

from core_solver.optimise.presets import PRESETS
from core_solver.optimise.switches import Switchable


@pytest.mark.parametrize("preset", PRESETS.values(), ids=PRESETS.keys())
def test_what_is_left_out_is_off_and_all_else_stays(preset: Switchable) -> None:
    first, *_, last = preset.terms()
    less = preset.without(first, last)
    assert type(less) is type(preset)
    assert (getattr(less.weights, first), getattr(less.weights, last)) == (0, 0)
    kept = {name: getattr(preset.weights, name) for name in (first, last)}
    assert min(kept.values()) > 0
    assert replace(less, weights=replace(less.weights, **kept)) == preset
    with pytest.raises(ValueError, match=f"no term is called hopes: choose from {first}, "):
        preset.without(first, "hopes")
