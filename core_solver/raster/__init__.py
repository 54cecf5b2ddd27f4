"""The fused depth and silhouette operator."""

from core_solver.raster.depth import depth_buffer
from core_solver.raster.pinhole import Pinhole

__all__ = ["Pinhole", "depth_buffer"]
