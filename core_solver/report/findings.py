"""What somebody who works with a take should know, in plain sentences with the frames they concern."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.report.evidence import Reprojection
from core_solver.report.measures import PersonMeasures
from core_solver.take import Person, Take

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Span = tuple[int, int]

_SKATE_M_PER_S = 0.15  # slower creeping is not noticed
_SUNK_M = 0.05  # inside the ground
_POOR_CONFIDENCE = 0.35
_OFF_SHARE = 0.08  # of the body's extent in the picture
_JUMP_M_PER_S = 12.0  # nobody moves the pelvis faster
_STEADY_S = 0.1  # shorter events are noise
_GAP_S = 0.1  # two events this near are one
_NAMED_SPANS = 3
_PLAUSIBLE_HEIGHTS = (0.8, 2.15)  # metres


@dataclass(frozen=True)
class Finding:
    """One sentence.

    Attributes:
        text: plain words.
        person: index of the person it is about, None for the whole take.
        spans: frames of the take it concerns, (first, last) both included; empty for all of them.
    """

    text: str
    person: int | None = None
    spans: tuple[Span, ...] = ()


def find_all(take: Take, measures: Sequence[PersonMeasures], reprojection: Reprojection | None) -> tuple[Finding, ...]:
    """All findings: those of the take as a whole first, then person by person."""
    findings = list(_about_take(take))
    for index, (person, measured) in enumerate(zip(take.people, measures, strict=True)):
        clock = _Clock(take, index, person.name)
        findings += _about_sight(person, clock)
        findings += _about_size(person, index)
        findings += _about_feet(person, measured, clock)
        findings += _about_motion(person, measured, clock)
        findings += _about_confidence(person, measured, clock)
        if reprojection is not None:
            findings += _about_picture(reprojection.pixels[index], reprojection.sizes[index], clock)
    return tuple(findings)


def runs(mask: Mask, bridge: int = 0, shortest: int = 1) -> list[Span]:
    """Stretches (first, last) of True, gaps of up to `bridge` frames closed, those of fewer true frames left out."""
    true = np.flatnonzero(mask)
    groups = np.split(true, np.flatnonzero(np.diff(true) > bridge + 1) + 1)
    return [(int(g[0]), int(g[-1])) for g in groups if g.size >= max(shortest, 1)]


class _Clock:
    """Seconds and frame numbers of one person's sentences."""

    def __init__(self, take: Take, index: int, name: str) -> None:
        self.name, self.index = name, index
        self.times = take.times
        self._first, self._step = take.meta.first_frame, take.meta.frame_step
        intervals = np.diff(take.times)
        self.interval = float(np.median(intervals)) if intervals.size else 1 / float(take.meta.frame_rate)

    def frames(self, seconds: float) -> int:
        return max(1, round(seconds / self.interval))

    def events(self, mask: Mask) -> list[Span]:
        """Stretches long enough to be noticed."""
        shortest = min(max(2, self.frames(_STEADY_S)), len(mask))
        return runs(mask, bridge=self.frames(_GAP_S), shortest=shortest)

    def number(self, frame: int) -> int:
        """The frame's number in the video."""
        return self._first + self._step * frame

    def words(self, spans: Sequence[Span]) -> str:
        """Such as "frame 7" or "frames 7-9 and 12-20": the longest three, and how many more there are."""
        named = sorted(sorted(spans, key=lambda s: s[0] - s[1])[:_NAMED_SPANS])
        parts = [str(self.number(a)) if a == b else f"{self.number(a)}-{self.number(b)}" for a, b in named]
        plural = len(spans) > 1 or spans[0][0] != spans[0][1]
        if len(spans) > _NAMED_SPANS:
            parts.append(f"{len(spans) - _NAMED_SPANS} shorter stretches")
        listed = ", ".join(parts[:-1]) + " and " + parts[-1] if len(parts) > 1 else parts[0]
        return f"{'frames' if plural else 'frame'} {listed}"

    def finding(self, text: str, spans: Sequence[Span]) -> Finding:
        """The sentence with `{name}` and `{frames}` filled in."""
        return Finding(text.format(name=self.name, frames=self.words(spans)), self.index, tuple(spans))


def _about_take(take: Take) -> Iterator[Finding]:
    said = " ".join(take.meta.warnings).lower()
    yield from (Finding(sentence) for sentence in take.meta.warnings)
    if take.meta.camera.source.startswith("assumed") and "field of view" not in said:
        yield Finding("The field of view is an assumption: all distances scale with it.")
    if take.meta.depth_source == "ground-plane prior" and "ground plane" not in said:
        yield Finding("Without a depth network the scene is a ground plane, a prior and no measurement.")
    if not take.people:
        yield Finding("Nobody is in this take.")
    if len(take.scene.points) == 0:
        yield Finding("The take holds no cloud of the scene.")


def _about_sight(person: Person, clock: _Clock) -> Iterator[Finding]:
    seen = np.flatnonzero(person.valid)
    last_frame = len(person.valid) - 1
    if seen.size == 0:
        yield clock.finding("{name} is never seen: all of the motion is filled in.", [(0, last_frame)])
        return
    first, last = int(seen[0]), int(seen[-1])
    hidden = [span for span in runs(~person.valid) if first < span[0] < last]
    if hidden:
        yield clock.finding("{name} is hidden in {frames}: the motion there is filled in.", hidden)
    if first > 0:
        yield Finding(f"{clock.name} is not seen before frame {clock.number(first)}.", clock.index, ((0, first - 1),))
    if last < last_frame:
        yield Finding(
            f"{clock.name} is not seen after frame {clock.number(last)}.", clock.index, ((last + 1, last_frame),)
        )


def _about_size(person: Person, index: int) -> Iterator[Finding]:
    low, high = _PLAUSIBLE_HEIGHTS
    if not low <= person.height_m <= high:
        kind = "small" if person.height_m < low else "tall"
        yield Finding(f"{person.name} is unusually {kind} at {person.height_m:.2f} m: check the field of view.", index)


def _about_feet(person: Person, measured: PersonMeasures, clock: _Clock) -> Iterator[Finding]:
    slides = np.where(person.valid[:, None], np.nan_to_num(measured.skate), 0).max(axis=1)
    events = clock.events(slides > 1000 * _SKATE_M_PER_S * clock.interval)
    if events:
        means = [slides[a : b + 1][slides[a : b + 1] > 0].mean() for a, b in events]
        much = f"{'up to ' if len(events) > 1 else ''}{max(means):.0f} mm a frame"
        yield clock.finding(f"The feet of {{name}} slide {much} in {{frames}}.", events)
    sunk = clock.events(person.valid & (measured.lowest < -_SUNK_M))
    if sunk:
        depth = -100 * min(float(measured.lowest[a : b + 1].min()) for a, b in sunk)
        yield clock.finding(f"{{name}} sinks up to {depth:.0f} cm below the ground plane in {{frames}}.", sunk)


def _about_motion(person: Person, measured: PersonMeasures, clock: _Clock) -> Iterator[Finding]:
    if len(clock.times) < 2:
        return
    step = np.linalg.norm(np.diff(measured.joints[:, 0], axis=0), axis=-1)
    jumps = np.flatnonzero((step / np.diff(clock.times) > _JUMP_M_PER_S) & person.valid[1:] & person.valid[:-1]) + 1
    if jumps.size:
        mask = np.zeros(len(clock.times), bool)
        mask[jumps] = True
        yield clock.finding(f"{{name}} jumps by up to {step[jumps - 1].max():.1f} m at {{frames}}.", runs(mask))


def _about_confidence(person: Person, measured: PersonMeasures, clock: _Clock) -> Iterator[Finding]:
    poor = clock.events(person.valid & (measured.confidence < _POOR_CONFIDENCE))
    if poor:
        yield clock.finding("{name} is seen poorly in {frames}: the pose there is partly a guess.", poor)


def _about_picture(pixels: Array, sizes: Array, clock: _Clock) -> Iterator[Finding]:
    off = clock.events(np.nan_to_num(pixels) > _OFF_SHARE * np.nan_to_num(sizes, nan=np.inf))
    if off:
        worst = max(float(np.nanmax(pixels[a : b + 1])) for a, b in off)
        yield clock.finding(f"The body of {{name}} lies up to {worst:.0f} pixels off what was seen in {{frames}}.", off)
