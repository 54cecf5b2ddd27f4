"""The fused depth and silhouette operator.

`raster.autograd` (torch), `raster.reference` (torch, slow) and `raster.warp_backend` (GPU) are not imported here.
"""

from core_solver.raster.contours import Contours, contours
from core_solver.raster.depth import depth_buffer
from core_solver.raster.pinhole import Pinhole
from core_solver.raster.terms import RasterTerms, fused, solve_terms
from core_solver.raster.visibility import visibility

__all__ = ["Contours", "Pinhole", "RasterTerms", "contours", "depth_buffer", "fused", "solve_terms", "visibility"]
