# SPDX-License-Identifier: GPL-3.0-or-later
"""Many takes to files without a window."""
