"""Errors that are the user's to mend: each message is one line with the name, the value and what is allowed."""


class UserError(Exception):
    """Something given to the program that it cannot work with."""


class ParameterError(UserError, ValueError):
    """A parameter, an axis or a setting that the model does not allow."""


class StoreError(UserError, OSError):
    """A file that cannot be written, or that is no cube."""
