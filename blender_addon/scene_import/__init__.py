# SPDX-License-Identifier: GPL-3.0-or-later
"""From a take to Blender's datablocks."""
