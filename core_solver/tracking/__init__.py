"""Identity over time: detections become tracks, gaps are filled and marked."""
