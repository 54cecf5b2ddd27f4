"""Makes the sample take, its footage and the sample rig that the extension carries.

Everything is made up here from formulas, and CC0.
"""
