"""Disparity to depth, median aggregation, point cloud, gravity and ground, contacts."""
