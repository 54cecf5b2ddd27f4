# SPDX-License-Identifier: GPL-3.0-or-later
"""Making solved motion better, one operation each: pure numpy, no Blender."""
