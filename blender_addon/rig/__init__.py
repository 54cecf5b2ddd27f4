# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's armatures as the arrays of `retarget`, and back."""
