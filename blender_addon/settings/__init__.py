# SPDX-License-Identifier: GPL-3.0-or-later
"""What the sections of the sidebar remember with the scene."""
