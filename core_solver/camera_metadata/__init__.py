"""What a video file says about its lens: read from its boxes, never from its pictures."""

from core_solver.camera_metadata.lens import StoredLens, camera_from_metadata, stored_lens

__all__ = ["StoredLens", "camera_from_metadata", "stored_lens"]
