"""The whole story on one page: perceive -> track -> solve -> take."""

import errno
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from core_solver.assemble import Provenance, assemble_take, person_colour
from core_solver.body import BodyModel, load_body
from core_solver.camera import Camera, CameraEstimate, camera_from_fov, read_camera
from core_solver.camera_estimation import estimate_camera
from core_solver.camera_metadata import camera_from_metadata
from core_solver.errors import CameraError, UserError, VideoError
from core_solver.optimise.presets import PRESETS
from core_solver.optimise.solution import Solution
from core_solver.optimise.solve import solve
from core_solver.perception.cache import observe
from core_solver.perception.perceive import Networks, label_size, load_networks, with_declared
from core_solver.perception.precomputed.given import open_modalities
from core_solver.perception.precomputed.join import Helpers, load_helpers
from core_solver.perception.store import ModelStore
from core_solver.progress import Progress
from core_solver.scene import aggregate
from core_solver.scene.edges import find_edges
from core_solver.stabilise import Shake, find_shake, steady
from core_solver.take import Scene, Take, write_take
from core_solver.tracking import Modalities, describe_left_out, find_people, gather, read_edits, write_identities
from core_solver.tracking.upright import describe_turned
from core_solver.video import CameraMotion, VideoClip, camera_motion, open_video

GROUND_PLANE_PRIOR = "ground-plane prior"
CLOUD_POINTS = 200_000
IDENTITIES_FILE = "identities.json"

_PRIOR_GRID = 320  # longer side of the depth map of the ground-plane prior
_EDGE_PICTURES = 5  # in which straight edges are sought
_PICTURES = 25  # frames whose median gives the background's colours
_MOTION_FRAMES = 12
_VIEW_PICTURES = 5  # whose median is the field of view that a depth network sees
_BEYOND_PEOPLE = 2.5  # the ground-plane prior's floor ends this many times as far away as the farthest person


@dataclass(frozen=True)
class SolveOptions:
    """What the user asked for.

    Attributes:
        video: the footage.
        output: where the take goes.
        camera: file with intrinsics, `PATH` or `PATH:NAME`.
        fov_degrees: field of view along the longer side, instead of a file.
        start_s: seconds into the video.
        end_s: seconds into the video.
        every: use every n-th frame.
        rotate: degrees clockwise by which to turn the picture, for a file whose rotation flag is wrong.
        people: keep this many at most.
        identities: file with the user's edits of who is who.
        depth: disparity network, a file or a directory with one file for each shape.
        networks: the user's own networks: TOML files, or names in the catalogue.
        modalities: folder with what other programs have already seen.
        models_dir: where models are kept.
        offline: fetch no models.
        body: a user's own SMPL file.
        device: "auto", "cpu" or "cuda".
        preset: name in `PRESETS`.
        resume: continue from what an earlier run has kept.
        seed: recorded; the solve draws no random numbers.
        points: of the scene's cloud, at most.
    """

    video: Path
    output: Path
    camera: str | None = None
    fov_degrees: float | None = None
    start_s: float | None = None
    end_s: float | None = None
    every: int = 1
    rotate: int = 0
    people: int | None = None
    identities: Path | None = None
    depth: Path | None = None
    networks: tuple[str, ...] = ()
    modalities: Path | None = None
    models_dir: Path | None = None
    offline: bool = False
    body: Path | None = None
    device: str = "auto"
    preset: str = "fast"
    resume: bool = False
    seed: int = 0
    points: int = CLOUD_POINTS


def solve_video(options: SolveOptions, progress: Progress) -> Take:
    """Solve a video and write its take.

    Raises:
        UserError: anything the user can mend; an old take at `options.output` is then untouched.
    """
    check_output(options.output)
    edits = read_edits(options.identities) if options.identities else ()
    device = choose_device(options.device)
    clip = open_video(options.video, options.start_s, options.end_s, options.every, options.rotate)
    known_camera = choose_camera(options, clip, progress)
    store = ModelStore(options.models_dir, offline=options.offline)
    body = load_body(options.body or store.require("open-body"))
    networks = _choose_networks(options, store, clip, body, progress)
    if known_camera is None and options.networks:
        known_camera = seen_camera(networks, clip, progress)
    depth_source = _depth_source(networks, clip, progress)
    observations = list(observe(clip, networks, work_directory(options.output), progress, resume=options.resume))
    size = (clip.width, clip.height)
    motion = camera_motion([picture for _, picture in clip.spread(_MOTION_FRAMES)])
    shake = find_shake(clip, observations, motion)
    if shake is not None:
        observations = steady(observations, shake.maps, size, label_size(*size))
    found = find_people(observations, size, people=options.people)
    modalities = gather(observations, found, size, label_size(*size), edits)
    colours = {track.id: person_colour(index) for index, track in enumerate(modalities.tracks)}
    write_identities(
        work_directory(options.output) / IDENTITIES_FILE, found.people, edits, modalities.frames.tolist(), colours
    )
    _require_people(modalities, clip)
    edges = find_edges(_pictures(clip, modalities, _EDGE_PICTURES, shake), modalities.labels)
    modalities = replace(modalities, edges=edges)
    estimate = known_camera or _estimate_camera(modalities, progress)
    camera = estimate.stated()
    warnings = _warnings(estimate, modalities, depth_source, motion, shake)
    for warning in warnings[:1] if motion.is_moving or shake is not None else ():
        progress.note(warning)
    solution = solve(modalities, camera, body, progress, PRESETS[options.preset], device)
    with progress.stage("Build the scene", 1) as advance:
        scene = build_scene(modalities, solution, camera, clip, options.points, shake)
        advance(1)
    provenance = Provenance(depth_source, options.preset, _settings(options), warnings)
    steadying = None if shake is None else shake.maps
    take = assemble_take(modalities, solution, camera, body, clip, scene, provenance, steadying)
    write_take(options.output, take)
    return take


def check_output(output: Path) -> None:
    """Find out before hours of work whether the take can be written.

    Raises:
        UserError: not a .npz name, a directory, or a place that cannot be written.
    """
    if output.suffix != ".npz" or output.is_dir():
        raise UserError(f"the take {output} must be a file name that ends in .npz: change -o")
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        probe = output.parent / f".{output.name}.{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        full = error.errno in {errno.ENOSPC, errno.EDQUOT}
        advice = "free some space" if full else "choose another place with -o"
        raise UserError(f"cannot write to {output.parent} ({error.strerror}): {advice}") from error


def work_directory(output: Path) -> Path:
    """Where the stages of a take keep their results: NAME.work beside NAME.npz."""
    return output.with_suffix(".work")


def choose_device(name: str) -> str:
    """The torch device for "auto", "cpu" or "cuda".

    Raises:
        UserError: CUDA was asked for and there is none.
    """
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if name == "cuda" and not torch.cuda.is_available():
        raise UserError("no CUDA device was found: leave --device out or install PyTorch with CUDA")
    return name


def choose_camera(options: SolveOptions, clip: VideoClip, progress: Progress) -> CameraEstimate | None:
    """Intrinsics from a file, a given field of view or the video's metadata; None where none of them says anything.

    Raises:
        CameraError: the file does not fit, or both were given.
    """
    if options.camera is not None and options.fov_degrees is not None:
        raise CameraError("--camera and --fov exclude each other: the camera file already holds the field of view")
    if options.camera is not None:
        return CameraEstimate(read_camera(options.camera, clip.width, clip.height))
    if options.fov_degrees is not None:
        given = camera_from_fov(clip.width, clip.height, options.fov_degrees, "field of view given by the user")
        return CameraEstimate(given)
    stored = camera_from_metadata(clip.path, clip.width, clip.height)
    if stored is not None:
        camera = stored.stated()
        progress.note(
            f"Field of view: {camera.fov_degrees:.0f} degrees along the longer side ({camera.source}). Stabilisation "
            "and some video modes show less than the lens does: give --camera or --fov if you know better."
        )
        return stored
    progress.note(
        "No camera file: the field of view is estimated from the people. Distances depend on it: give --camera or "
        "--fov if you know better."
    )
    return None


def _choose_networks(
    options: SolveOptions, store: ModelStore, clip: VideoClip, body: BodyModel, progress: Progress
) -> Networks | Helpers:
    """All networks, or, where a folder gives some modalities, those for the rest."""
    if options.modalities is None:
        return with_declared(load_networks(store, options.depth), options.networks, store, options.device)
    given = open_modalities(options.modalities, clip, body)
    for note in given.notes:
        progress.note(note)
    return load_helpers(store, options.depth, options.networks, options.device, given)


def build_scene(
    modalities: Modalities, solution: Solution, camera: Camera, clip: VideoClip, most_points: int = CLOUD_POINTS,
    shake: Shake | None = None,
) -> Scene:  # fmt: skip
    """Static depth map and coloured cloud: from the network's disparity, else from the ground-plane prior."""
    inverse_far, inverse_gap = solution.inverse_far, solution.inverse_gap
    if modalities.disparity is not None:
        depth = aggregate.median_depth(modalities, inverse_far, inverse_gap)
    else:
        farthest = _BEYOND_PEOPLE * float(np.linalg.norm(solution.gamma, axis=-1).max())
        depth = aggregate.ground_depth(camera, solution.ground, _prior_grid(clip), farthest)
        inverse_far, inverse_gap = _depth_range(depth, len(modalities.times))
    picture = _background_picture(clip, modalities, (depth.shape[1], depth.shape[0]), shake)
    points, colours = aggregate.cloud(depth, picture, camera, most_points)
    return Scene(
        points,
        colours,
        depth,
        z_near=(1 / (inverse_far + inverse_gap)).astype(np.float32),
        z_far=(1 / inverse_far).astype(np.float32),
    )


def seen_camera(networks: Networks | Helpers, clip: VideoClip, progress: Progress) -> CameraEstimate | None:
    """The field of view that a declared depth network sees, if it says."""
    view = networks.declared.field_of_view(picture for _, picture in clip.spread(_VIEW_PICTURES))
    if view is None:
        return None
    progress.note(f"The depth network sees a field of view of {view:.1f} degrees, which is used instead.")
    return CameraEstimate(camera_from_fov(clip.width, clip.height, view, "field of view seen by the depth network"))


def _estimate_camera(modalities: Modalities, progress: Progress) -> CameraEstimate:
    estimate = estimate_camera(modalities)
    view, source = estimate.camera.fov_degrees, estimate.stated().source
    progress.note(f"Field of view: {view:.0f} degrees along the longer side, {source}.")
    return estimate


def _depth_source(networks: Networks | Helpers, clip: VideoClip, progress: Progress) -> str:
    if isinstance(networks, Helpers) and networks.given.depth_source is not None:
        return networks.given.depth_source
    network = networks.open_disparity(clip.width, clip.height)
    if network is not None:
        return network.path.name
    progress.note(
        "No depth network was found: depth rests on people's feet and the ground plane alone "
        "(give a network with --depth FILE for a real scene cloud)."
    )
    return GROUND_PLANE_PRIOR


def _require_people(modalities: Modalities, clip: VideoClip) -> None:
    if modalities.tracks:
        return
    seen = "people were seen too briefly" if modalities.dropped else "nobody was seen"
    raise VideoError(
        f"{seen} in {clip.path.name}: a person must be visible for a tenth of the clip or 1.5 s, and 8 frames; "
        "try another part with --start and --end"
    )


def _warnings(
    camera: CameraEstimate, modalities: Modalities, depth_source: str, motion: CameraMotion, shake: Shake | None
) -> tuple[str, ...]:
    sentences = []
    if shake is not None:
        sentences.append(shake.describe())
    elif motion.is_moving:
        sentences.append(
            f"The camera moves: the background drifts by {motion.drift_px:.0f} pixels. The solver assumes a static "
            "camera, so places and feet will be wrong; use footage from a tripod."
        )
    if camera.focal_sigma > 0:
        source = camera.stated().source
        sentences.append(f"The field of view is no calibration ({source}): all distances scale with it.")
    sentences += describe_turned(modalities)
    if depth_source == GROUND_PLANE_PRIOR:
        sentences.append("Without a depth network the scene is a ground plane, a prior and no measurement.")
    sentences += describe_left_out(modalities.dropped)
    if len(modalities.tracks) == 1:
        sentences.append("One person alone: their size rests on the prior that people are 1.65 m tall on average.")
    return tuple(sentences)


def _background_picture(
    clip: VideoClip, modalities: Modalities, size: tuple[int, int], shake: Shake | None
) -> NDArray[np.uint8]:
    return aggregate.median_picture(_pictures(clip, modalities, _PICTURES, shake), modalities.labels, size)


def _pictures(
    clip: VideoClip, modalities: Modalities, count: int, shake: Shake | None
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Take frames and pictures spread over the clip, as a camera that stands still sees them."""
    position = {int(frame): t for t, frame in enumerate(modalities.frames)}
    for info, picture in clip.spread(count):
        t = position[info.index]
        yield t, picture if shake is None else shake.steady_picture(t, picture)


def _prior_grid(clip: VideoClip) -> tuple[int, int]:
    factor = _PRIOR_GRID / max(clip.width, clip.height)
    return max(1, round(clip.width * factor)), max(1, round(clip.height * factor))


def _depth_range(depth: NDArray[np.float32], frames: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    known = depth[np.isfinite(depth)]
    near, far = (float(known.min()), float(known.max())) if known.size else (1.0, 100.0)
    return np.full(frames, 1 / far), np.full(frames, max(1 / near - 1 / far, 1e-6))


def _settings(options: SolveOptions) -> dict[str, str | float | int | bool | None]:
    """What was asked for, without paths: a take does not tell where its maker keeps things."""
    return {
        "start_s": options.start_s, "end_s": options.end_s, "every": options.every, "people": options.people,
        "rotate": options.rotate,
        "points": options.points, "seed": options.seed, "device": options.device,
        "modalities": options.modalities is not None,
        "networks": ", ".join(Path(name).stem for name in options.networks),
    }  # fmt: skip
