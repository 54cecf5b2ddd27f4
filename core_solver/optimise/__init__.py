"""Variables, starting values, stage schedule and optimisers."""
