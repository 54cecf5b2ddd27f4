"""Identity over time: detections become tracks, gaps are filled and marked."""

from core_solver.tracking.link import track_people
from core_solver.tracking.selection import describe_left_out
from core_solver.tracking.tracks import BACKGROUND, UNCLAIMED, DroppedTrack, Modalities, Track

__all__ = ["BACKGROUND", "UNCLAIMED", "DroppedTrack", "Modalities", "Track", "describe_left_out", "track_people"]
