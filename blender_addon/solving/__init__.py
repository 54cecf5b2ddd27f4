# SPDX-License-Identifier: GPL-3.0-or-later
"""The solver as a child process in a Python of its own: Blender needs none of its packages."""
