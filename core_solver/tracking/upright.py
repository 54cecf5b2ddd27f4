"""Which way people stand in the picture: a video that is stored turned shows all of them on their side."""

import numpy as np

from core_solver.body.skeleton import keypoint_index
from core_solver.tracking.tracks import Modalities

_HIGH = [keypoint_index(f"{side}_shoulder") for side in ("left", "right")]
_LOW = [keypoint_index(f"{side}_{part}") for side in ("left", "right") for part in ("hip", "ankle")]
_SEEN = 0.3  # mean confidence of these keypoints
_ENOUGH = 20  # sights
_MOST = 0.8  # share of the sights that agree
_DIRECTIONS = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]])  # feet down, right, up, left
_TURNS = (0, 90, 180, 270)  # that set these upright, degrees clockwise


def turn_to_upright(modalities: Modalities) -> int:
    """By how many degrees the picture must be turned clockwise so that people stand: 0, 90, 180 or 270.

    Other than 0 only where nearly everybody nearly always has the feet towards the same wrong side of the picture.
    """
    votes = np.zeros(len(_TURNS))
    for track in modalities.tracks:
        seen = track.valid & (track.confidence[:, _HIGH + _LOW].mean(axis=1) > _SEEN)
        down = track.keypoints[seen][:, _LOW].mean(axis=1) - track.keypoints[seen][:, _HIGH].mean(axis=1)
        votes += np.bincount((down @ _DIRECTIONS.T).argmax(axis=1), minlength=len(_TURNS))
    best = int(votes.argmax())
    return _TURNS[best] if votes.sum() >= _ENOUGH and votes[best] >= _MOST * votes.sum() else 0


def describe_turned(modalities: Modalities) -> list[str]:
    """What to tell the user when people do not stand upright in the picture; nothing when they do."""
    turn = turn_to_upright(modalities)
    if turn == 0:
        return []
    how = "stand on their heads" if turn == 180 else "lie on their side"
    return [f"People {how} in the picture: if the video's rotation flag is wrong, solve it again with --rotate {turn}."]
