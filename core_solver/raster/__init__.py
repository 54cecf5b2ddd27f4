"""The fused depth and silhouette operator."""
