"""One pure function per energy term of the method."""
