# SPDX-License-Identifier: GPL-3.0-or-later
"""From one skeleton to another: pure numpy, no Blender."""
