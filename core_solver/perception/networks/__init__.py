"""The user's own networks, declared in a few lines of TOML: what they are shown, and how their answers are read."""
