"""The extension in a real Blender window, on a virtual display.

Run apart: `python -m pytest tests/window`. Needs Xvfb and a Blender of at least 4.3 on the path (or named by BLENDER);
skipped without. Screenshots go to the folder named by WINDOW_SHOTS, else to pytest's temporary one.
"""
