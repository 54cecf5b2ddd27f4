"""Scene-Aware Mocap: several people from one video of one static camera, in one metric world."""

__version__ = "0.1.0"
