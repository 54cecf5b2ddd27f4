"""Identity over time: detections become tracks, gaps are filled and marked; the user has the last word."""

from core_solver.tracking.identities import read_edits, write_identities
from core_solver.tracking.link import find_people, gather, track_people
from core_solver.tracking.selection import describe_left_out
from core_solver.tracking.tracks import BACKGROUND, UNCLAIMED, DroppedTrack, Modalities, Track

__all__ = [
    "BACKGROUND",
    "UNCLAIMED",
    "DroppedTrack",
    "Modalities",
    "Track",
    "describe_left_out",
    "find_people",
    "gather",
    "read_edits",
    "track_people",
    "write_identities",
]
