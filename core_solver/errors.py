"""The one family of errors a user can cause. Standard library only, so that every room and Blender can import it."""


class UserError(Exception):
    """Something the user can mend: the message is one line that says what is wrong and what to do."""


class TakeError(UserError):
    """A take file that is damaged, foreign or of a newer version."""


class VideoError(UserError):
    """A video that cannot be read or holds nothing to solve."""


class CameraError(UserError):
    """A camera file that cannot be read or does not fit the video."""


class ModelError(UserError):
    """A network or body model that is missing, damaged or of the wrong kind."""
